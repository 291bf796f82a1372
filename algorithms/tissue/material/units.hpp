// Conversion between mm, as everywhere in Bregma, and SI, in which the tissue solver works.
#pragma once

#include <Eigen/Core>

namespace bregma::tissue {

inline constexpr double kMetre = 1000.0; // mm
inline constexpr float kMetreFloat = 1000.0F;

[[nodiscard]] inline Eigen::Vector3f to_metres(const Eigen::Vector3d &mm) { return (mm / kMetre).cast<float>(); }

} // namespace bregma::tissue
