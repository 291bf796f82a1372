// Maximises a measure over rigid or affine maps, by its gradient (BFGS) or without one (Powell). Internal to the room.
//
// A step is a motion of the reference about a centre: T' = T E(d). Rotations and scales are counted in mm at kArm_mm
// from the centre, so that all parameters have one unit.
#pragma once

#include <Eigen/Core>

#include "algorithms/intensity/similarity_measure.hpp"

namespace bregma::intensity {

inline constexpr double kArm_mm = 60.0; // about the radius of a brain

using Step = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 12, 1>;

// E(d): 6 parameters are rotation and translation, 12 a linear map, row by row, and translation.
[[nodiscard]] Eigen::Matrix4d motion_of(const Step &step, const Eigen::Vector3d &centre_mm);
// d(value) / d(step) at step 0.
[[nodiscard]] Step step_gradient(const AffineGradient &gradient, const Eigen::Matrix4d &T_floating_reference,
                                 const Eigen::Vector3d &centre_mm, int parameters);

struct OptimiserOptions {
  int parameters = 6; // or 12
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  double first_step_mm = 4.0;
  double tolerance_mm = 0.02; // steps below it end the search
  int max_iterations = 60;
};

struct Optimum {
  Eigen::Matrix4d T_floating_reference = Eigen::Matrix4d::Identity();
  double value = 0.0; // NaN if the start has none
  int evaluations = 0;
  double last_step_mm = 0.0;
};

// With a measure that has a gradient only.
[[nodiscard]] Optimum maximise_by_gradient(SimilarityMeasure &measure, const Eigen::Matrix4d &start,
                                           const OptimiserOptions &options);
// Lines along a set of directions, of which the least useful is replaced by the whole step [Powell 1964].
[[nodiscard]] Optimum maximise_by_lines(SimilarityMeasure &measure, const Eigen::Matrix4d &start,
                                        const OptimiserOptions &options);

} // namespace bregma::intensity
