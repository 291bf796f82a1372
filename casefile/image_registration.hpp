// The result of `bregma image register --result`: a registration of two images with its covariance, and what identifies
// the images. JSON, from outside: its form is checked before it is used.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/image/grid.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// Voxels and grid of an image, whatever its file's format is.
struct ImageIdentity {
  std::array<int, 3> size{};
  Eigen::Matrix4d T_ras_voxel = Eigen::Matrix4d::Identity();
  std::string voxels_sha256; // of the voxels as floats, in hexadecimal
};
[[nodiscard]] ImageIdentity identity_of(const image::Image<float, 3> &volume);
// Why these are two images; empty if they are one. Positions agree to 0.01 mm.
[[nodiscard]] std::optional<std::string> difference(const ImageIdentity &a, const ImageIdentity &b);

struct ImageRegistration {
  geometry::UncertainPose<geometry::frame::Image, geometry::frame::Source> T_image_source;
  std::string measure, verdict, date;
  ImageIdentity source, target;
};

// Errors name the file and the value.
[[nodiscard]] base::Result<ImageRegistration> read_image_registration(const std::filesystem::path &file);

} // namespace bregma::casefile
