// The slices of one series, collected to a stack. Units: mm, frame Device. One thread.
#pragma once

#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "algorithms/image/grid.hpp"
#include "idl/topics.hpp"

namespace bregma::server {

// Device, mm per Hz: by how much B0 displaces a spin in this slice (mri/separation.hpp). Zero where the slice does not
// state its read-out and bandwidth.
[[nodiscard]] Eigen::Vector3d movement_by_b0(const wire::ImageSlice &slice);

class SliceStack {
public:
  // An accepted slice, as are those of add(). The series is that of this slice.
  explicit SliceStack(const wire::ImageSlice &first);

  // Refused, with nothing done: a slice of another series, size or plane than the first, and one that is there already.
  [[nodiscard]] tl::expected<void, std::string> add(const wire::ImageSlice &slice);
  [[nodiscard]] std::uint32_t series() const { return series_; }
  [[nodiscard]] std::uint32_t expected() const { return static_cast<std::uint32_t>(size_[2]); }
  [[nodiscard]] std::uint32_t received() const { return received_; }
  [[nodiscard]] bool complete() const { return received_ == expected(); }
  [[nodiscard]] const std::vector<float> &slice(std::uint32_t index) const { return slices_[index]; } // from 0
  [[nodiscard]] const Eigen::Vector3d &origin_mm(std::uint32_t index) const { return origins_mm_[index]; }
  [[nodiscard]] const Eigen::Matrix3d &axes() const { return axes_; }

  // Slices as voxels, T_device_index as T_image_index. Otherwise a sentence: slices that are missing or not at equal
  // steps.
  [[nodiscard]] tl::expected<image::Image<float, 3>, std::string> stack() const;

private:
  std::uint32_t series_ = 0;
  std::array<int, 3> size_{};
  Eigen::Matrix3d axes_;
  Eigen::Vector2d spacing_mm_;
  double thickness_mm_ = 0.0;
  std::uint32_t received_ = 0;
  std::vector<std::vector<float>> slices_; // empty: not received
  std::vector<Eigen::Vector3d> origins_mm_;
};

} // namespace bregma::server
