// Whether two images can be registered, and whether a pose that was found is to be trusted (docs/images.md).
//
// Units: mm. Thread-safe: pure functions.
#pragma once

#include <string>
#include <string_view>

#include <Eigen/Core>

#include "algorithms/intensity/rigid_image.hpp"

namespace bregma::intensity {

// Share of restarts that have to come back to the pose.
inline constexpr double kMinReturned = 0.6;

// Why an image cannot be registered, as a sentence that calls it `name`; empty: it may be.
[[nodiscard]] std::string obstacle(const Volume &image, std::string_view name);

// Sets verdict and reason from the other members. centre_mm: of the reference. With options.affine the size was free,
// and is not judged. A measure that was measured to find wrong poses is never found.
void judge(RigidImageResult &result, const Eigen::Vector3d &centre_mm, const RigidImageOptions &options);

} // namespace bregma::intensity
