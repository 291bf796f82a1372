// Whether two images show a head of the same size: a wrong spacing in a header, or another head, is registered rigidly
// with a good similarity and a wrong pose. Internal to the room.
#pragma once

#include <Eigen/Core>

#include "algorithms/intensity/similarity_measure.hpp"

namespace bregma::intensity {

struct SizeDifference {
  // Of the floating image relative to the reference along the axis of the largest difference: 0.1 if its head is 10 %
  // larger. 0 if no affine map is better than the pose.
  double stretch = 0.0;
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ(); // in the reference, unit
  double rigid = 0.0;                              // the measure at the rigid pose
  double gain = 0.0;                               // of the affine map over it
};

// Continues a rigid pose with 12 parameters. The measure needs a gradient. centre_mm: in the reference.
[[nodiscard]] SizeDifference size_difference(SimilarityMeasure &measure, const Eigen::Matrix4d &T_floating_reference,
                                             const Eigen::Vector3d &centre_mm, double step_mm);

} // namespace bregma::intensity
