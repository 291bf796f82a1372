// Arithmetic on the first three components of the solver's nodal vectors. Results have 0 as the fourth component.
#pragma once

#include <Eigen/Core>

#include "algorithms/tissue/solver/element_kernel.hpp"

namespace bregma::tissue {

inline constexpr float kClamped = 1.0F; // fourth component of a velocity that was clamped to the maximum move per step

inline float *axes(NodeVector &v) { return &v.x; }
inline const float *axes(const NodeVector &v) { return &v.x; }

inline float dot(const NodeVector &a, const NodeVector &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

inline NodeVector sum(const NodeVector &a, const NodeVector &b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }

inline NodeVector difference(const NodeVector &a, const NodeVector &b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }

inline NodeVector scaled(const NodeVector &v, float by) { return {by * v.x, by * v.y, by * v.z}; }

inline Eigen::Vector3d to_double(const NodeVector &v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}

} // namespace bregma::tissue
