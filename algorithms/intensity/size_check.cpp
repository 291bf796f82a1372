#include "algorithms/intensity/size_check.hpp"

#include <cmath>

#include <Eigen/SVD>

#include "algorithms/intensity/pose_optimiser.hpp"

namespace bregma::intensity {

SizeDifference size_difference(SimilarityMeasure &measure, const Eigen::Matrix4d &T_floating_reference,
                               const Eigen::Vector3d &centre_mm, double step_mm) {
  OptimiserOptions how;
  how.parameters = 12;
  how.centre_mm = centre_mm;
  how.first_step_mm = step_mm;
  how.tolerance_mm = 0.1 * step_mm;
  SizeDifference out;
  out.rigid = measure.value(T_floating_reference);
  const Optimum found = maximise_by_gradient(measure, T_floating_reference, how);
  if (!(found.value > out.rigid)) {
    return out;
  }
  out.gain = found.value - out.rigid;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(found.T_floating_reference.topLeftCorner<3, 3>(), Eigen::ComputeFullV);
  for (Eigen::Index i = 0; i < 3; ++i) {
    if (const double stretch = svd.singularValues()[i] - 1.0; std::abs(stretch) > std::abs(out.stretch)) {
      out.stretch = stretch;
      out.axis = svd.matrixV().col(i);
    }
  }
  return out;
}

} // namespace bregma::intensity
