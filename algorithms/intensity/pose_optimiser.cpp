#include "algorithms/intensity/pose_optimiser.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Geometry>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::intensity {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;
using StepMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 12, 12>;

bool better(double value, double than) { return value > than || (std::isfinite(value) && !std::isfinite(than)); }

// Maximum along a line: a bracket by growing steps, then parabolas safeguarded by the golden section.
class LineSearch {
public:
  LineSearch(SimilarityMeasure &measure, const OptimiserOptions &options, Optimum &at)
      : measure_(measure), options_(options), at_(at) {}

  // Moves the optimum along the direction; returns the distance, mm.
  double along(const Step &direction, double first_mm) {
    const Matrix4d start = at_.T_floating_reference;
    const auto value = [&](double t) {
      ++at_.evaluations;
      return measure_.value(start * motion_of(t * direction, options_.centre_mm));
    };
    double middle = 0.0;
    double of_middle = at_.value;
    double ahead = first_mm;
    double of_ahead = value(ahead);
    double behind = -first_mm;
    double of_behind = value(behind);
    if (better(of_behind, of_ahead)) {
      std::swap(ahead, behind);
      std::swap(of_ahead, of_behind);
    }
    constexpr int kMaxDoublings = 6;
    for (int n = 0; n < kMaxDoublings && better(of_ahead, of_middle); ++n) {
      behind = std::exchange(middle, ahead);
      of_behind = std::exchange(of_middle, of_ahead);
      ahead = middle + 1.618 * (middle - behind);
      of_ahead = value(ahead);
    }
    constexpr int kMaxRefinements = 10;
    for (int n = 0; n < kMaxRefinements && std::abs(ahead - behind) > options_.tolerance_mm; ++n) {
      const double t = refined(behind, middle, ahead, of_behind, of_middle, of_ahead);
      const double of_t = value(t);
      const bool beyond = (t - middle) * (ahead - middle) > 0.0; // between middle and ahead
      if (better(of_t, of_middle)) {
        (beyond ? behind : ahead) = middle;
        (beyond ? of_behind : of_ahead) = of_middle;
        middle = t;
        of_middle = of_t;
      } else {
        (beyond ? ahead : behind) = t;
        (beyond ? of_ahead : of_behind) = of_t;
      }
    }
    at_.T_floating_reference = start * motion_of(middle * direction, options_.centre_mm);
    at_.value = of_middle;
    return std::abs(middle) * direction.norm();
  }

private:
  static double refined(double a, double b, double c, double of_a, double of_b, double of_c) {
    const double longer = std::abs(c - b) > std::abs(b - a) ? c - b : a - b;
    const double golden = b + 0.381966 * longer;
    const double p = (b - a) * (of_b - of_c);
    const double q = (b - c) * (of_b - of_a);
    const double parabola = b - 0.5 * ((b - a) * p - (b - c) * q) / (p - q);
    const double low = std::min(a, c);
    const double high = std::max(a, c);
    const double margin = 0.1 * (high - low);
    const bool usable = std::isfinite(parabola) && parabola > low + 0.2 * margin && parabola < high - 0.2 * margin &&
                        std::abs(parabola - b) > 0.05 * margin;
    return usable ? parabola : golden;
  }

  SimilarityMeasure &measure_;
  const OptimiserOptions &options_;
  Optimum &at_;
};

} // namespace

Matrix4d motion_of(const Step &step, const Vector3d &centre_mm) {
  Matrix3d linear;
  if (step.size() == 6) {
    linear = geometry::rotation_exp(step.head<3>() / kArm_mm).toRotationMatrix();
  } else {
    linear = Matrix3d::Identity();
    for (Eigen::Index row = 0; row < 3; ++row) {
      linear.row(row) += step.segment<3>(3 * row).transpose() / kArm_mm;
    }
  }
  Matrix4d out = Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = linear;
  out.topRightCorner<3, 1>() = centre_mm - linear * centre_mm + step.tail<3>();
  return out;
}

Step step_gradient(const AffineGradient &gradient, const Matrix4d &T_floating_reference, const Vector3d &centre_mm,
                   int parameters) {
  // T E: the derivative with respect to E, whose derivative is linear in the point relative to the centre.
  const AffineGradient by_motion = T_floating_reference.topLeftCorner<3, 3>().transpose() * gradient;
  const Matrix3d by_linear = by_motion.leftCols<3>() - by_motion.col(3) * centre_mm.transpose();
  Step out(parameters);
  if (parameters == 6) {
    out.head<3>() = Vector3d(by_linear(2, 1) - by_linear(1, 2), by_linear(0, 2) - by_linear(2, 0),
                             by_linear(1, 0) - by_linear(0, 1)) /
                    kArm_mm;
  } else {
    for (Eigen::Index row = 0; row < 3; ++row) {
      out.segment<3>(3 * row) = by_linear.row(row).transpose() / kArm_mm;
    }
  }
  out.tail<3>() = by_motion.col(3);
  return out;
}

Optimum maximise_by_gradient(SimilarityMeasure &measure, const Matrix4d &start, const OptimiserOptions &options) {
  Optimum at;
  at.T_floating_reference = start;
  AffineGradient by_affine;
  at.value = measure.value_and_gradient(start, by_affine);
  at.evaluations = 1;
  if (!std::isfinite(at.value)) {
    return at;
  }
  const auto gradient_at = [&](const Matrix4d &T) {
    return step_gradient(by_affine, T, options.centre_mm, options.parameters);
  };
  Step gradient = gradient_at(start);
  StepMatrix inverse; // of the negative Hessian
  bool fresh = true;
  for (int iteration = 0; iteration < options.max_iterations && gradient.norm() > 0.0; ++iteration) {
    if (fresh) {
      inverse = StepMatrix::Identity(options.parameters, options.parameters) * options.first_step_mm / gradient.norm();
    }
    Step step = inverse * gradient;
    if (step.norm() > 2.0 * options.first_step_mm) {
      step *= 2.0 * options.first_step_mm / step.norm();
    }
    // Backtracking until the value rises enough [Armijo].
    constexpr int kMaxHalvings = 8;
    constexpr double kEnough = 1e-4;
    Matrix4d T;
    double value = std::nan("");
    for (int n = 0; n < kMaxHalvings && step.norm() > 0.1 * options.tolerance_mm; ++n) {
      T = at.T_floating_reference * motion_of(step, options.centre_mm);
      value = measure.value_and_gradient(T, by_affine);
      ++at.evaluations;
      if (value > at.value + kEnough * step.dot(gradient)) {
        break;
      }
      value = std::nan("");
      step *= n == 0 ? 0.5 : 0.35;
    }
    if (!std::isfinite(value)) {
      if (fresh) {
        break; // not even the steepest direction rises
      }
      fresh = true;
      continue;
    }
    const Step next = gradient_at(T);
    const Step change = gradient - next; // of the negative value's gradient
    at.T_floating_reference = T;
    at.value = value;
    at.last_step_mm = step.norm();
    const double curvature = step.dot(change);
    if (curvature > 1e-12 * step.norm() * change.norm()) {
      if (fresh) {
        inverse = StepMatrix::Identity(options.parameters, options.parameters) * curvature / change.squaredNorm();
      }
      const StepMatrix left =
          StepMatrix::Identity(options.parameters, options.parameters) - step * change.transpose() / curvature;
      inverse = (left * inverse * left.transpose() + step * step.transpose() / curvature).eval();
      fresh = false;
    }
    gradient = next;
    if (step.norm() < options.tolerance_mm) {
      break;
    }
  }
  return at;
}

Optimum maximise_by_lines(SimilarityMeasure &measure, const Matrix4d &start, const OptimiserOptions &options) {
  Optimum at;
  at.T_floating_reference = start;
  at.value = measure.value(start);
  at.evaluations = 1;
  if (!std::isfinite(at.value)) {
    return at;
  }
  const auto n = static_cast<Eigen::Index>(options.parameters);
  StepMatrix directions = StepMatrix::Identity(n, n);
  double reach = options.first_step_mm;
  for (int iteration = 0; iteration < options.max_iterations / 6 + 1; ++iteration) {
    const Matrix4d before = at.T_floating_reference;
    Eigen::Index best = 0;
    double largest = 0.0;
    Step whole = Step::Zero(n);
    LineSearch line(measure, options, at);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double value = at.value;
      const Matrix4d from = at.T_floating_reference;
      const double moved = line.along(directions.col(i), reach);
      // Signed: the part of the translation or rotation along the direction.
      const Matrix4d step = from.inverse() * at.T_floating_reference;
      const Step plus = directions.col(i) * moved;
      const bool forwards =
          (motion_of(plus, options.centre_mm) - step).norm() < (motion_of(-plus, options.centre_mm) - step).norm();
      whole += forwards ? plus : Step(-plus);
      if (at.value - value > largest) {
        largest = at.value - value;
        best = i;
      }
    }
    at.last_step_mm = whole.norm();
    if (whole.norm() < options.tolerance_mm || (before - at.T_floating_reference).norm() == 0.0) {
      if (reach <= 2.0 * options.tolerance_mm) {
        break;
      }
    } else {
      directions.col(best) = whole.normalized();
      (void)line.along(directions.col(best), std::min(reach, whole.norm()));
      if (std::abs(directions.matrix().determinant()) < 0.05) { // nearly dependent
        directions = StepMatrix::Identity(n, n);
      }
    }
    reach = std::max(0.35 * reach, options.tolerance_mm);
  }
  return at;
}

} // namespace bregma::intensity
