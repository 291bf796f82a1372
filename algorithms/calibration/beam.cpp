#include "algorithms/calibration/beam.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include <Eigen/Dense>

#include "algorithms/calibration/rotation_spread.hpp"
#include "algorithms/geometry/angles.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::calibration {

namespace {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;

constexpr int kBeamSteps = 200;
constexpr double kSettled = 1e-9; // relative change of the cost
constexpr double kFixed_rad = 0.02;
constexpr double kTypicalRadius_mm = 50.0; // start of a sphere of unknown radius

// The unknowns: beam, and a plane n . p = d, or a sphere.
struct State {
  Beam beam;
  Vector3d body = Vector3d::UnitZ(); // normal of the plane, centre of the sphere
  double size = 0.0;                 // distance of the plane, radius of the sphere
};

Vector3d across(const Vector3d &direction, int which) {
  const Vector3d first = direction.unitOrthogonal();
  return which == 0 ? first : direction.cross(first);
}

Vector3d tilted(const Vector3d &direction, double a, double b) {
  return geometry::rotation_exp(a * across(direction, 0) + b * across(direction, 1)) * direction;
}

class BeamProblem {
public:
  BeamProblem(std::span<const BeamReading> readings, const BeamOptions &options)
      : readings_(readings), options_(options) {
    for (const BeamReading &reading : readings) {
      centre_ += reading.T_base_flange.translation() / static_cast<double>(readings.size());
    }
  }

  // Parameters: origin (3), tilt of the direction (2), then the body: tilt of the normal (2) and distance (1), or
  // centre (3) and, if unknown, radius (1).
  [[nodiscard]] Eigen::Index unknowns() const {
    return options_.body == BeamBody::kPlane || options_.radius_mm ? 8 : 9;
  }

  [[nodiscard]] State start(const Vector3d &direction) const {
    State out;
    out.beam.direction = direction;
    Vector3d mean = Vector3d::Zero();
    for (const BeamReading &reading : readings_) {
      mean += point(out, reading) / static_cast<double>(readings_.size());
    }
    if (options_.body == BeamBody::kSphere) {
      return start_sphere(out, mean);
    }
    Matrix3d spread = Matrix3d::Zero();
    for (const BeamReading &reading : readings_) {
      const Vector3d d = point(out, reading) - mean;
      spread += d * d.transpose();
    }
    out.body = Eigen::SelfAdjointEigenSolver<Matrix3d>(spread).eigenvectors().col(0);
    out.size = out.body.dot(mean);
    return out;
  }

  [[nodiscard]] State moved(const State &s, const Eigen::VectorXd &step) const {
    State out = s;
    out.beam.origin_mm += step.head<3>();
    out.beam.direction = tilted(s.beam.direction, step[3], step[4]).normalized();
    if (options_.body == BeamBody::kPlane) {
      out.body = tilted(s.body, step[5], step[6]).normalized();
      out.size += step[7];
    } else {
      out.body += step.segment<3>(5);
      out.size += unknowns() == 9 ? step[8] : 0.0;
    }
    return out;
  }

  // Distance of a reading's point from the body, its gradient, and its variance.
  struct Term {
    double distance = 0.0, variance = 0.0;
    Eigen::VectorXd gradient;
  };
  void term(const State &s, const BeamReading &reading, Term &out) const {
    const Matrix3d R = reading.T_base_flange.rotation_matrix();
    const Vector3d p = point(s, reading);
    const bool plane = options_.body == BeamBody::kPlane;
    const Vector3d from = p - s.body;
    const Vector3d normal = plane ? s.body : from.normalized();
    out.distance = plane ? s.body.dot(p) - s.size : from.norm() - s.size;
    out.gradient.resize(unknowns());
    const Vector3d in_flange = R.transpose() * normal;
    out.gradient.head<3>() = in_flange;
    for (int i = 0; i < 2; ++i) {
      out.gradient[3 + i] = reading.range_mm * in_flange.dot(across(s.beam.direction, i).cross(s.beam.direction));
    }
    if (plane) {
      for (int i = 0; i < 2; ++i) {
        out.gradient[5 + i] = across(s.body, i).cross(s.body).dot(p);
      }
      out.gradient[7] = -1.0;
    } else {
      out.gradient.segment<3>(5) = -normal;
      if (unknowns() == 9) {
        out.gradient[8] = -1.0;
      }
    }
    const double along = in_flange.dot(s.beam.direction) * options_.range_sigma_mm;
    out.variance = along * along + options_.robot_sigma_mm * options_.robot_sigma_mm;
  }

  // Sum of the squared weighted distances; the normal equations on request.
  double cost(const State &s, Eigen::MatrixXd *normal = nullptr, Eigen::VectorXd *gradient = nullptr) const {
    if (normal != nullptr) {
      normal->setZero(unknowns(), unknowns());
      gradient->setZero(unknowns());
    }
    double sum = 0.0;
    Term t;
    for (const BeamReading &reading : readings_) {
      term(s, reading, t);
      sum += t.distance * t.distance / t.variance;
      if (normal != nullptr) {
        *normal += t.gradient * t.gradient.transpose() / t.variance;
        *gradient += t.gradient * (t.distance / t.variance);
      }
    }
    return sum;
  }

  [[nodiscard]] double rms_mm(const State &s) const {
    double sum = 0.0;
    Term t;
    for (const BeamReading &reading : readings_) {
      term(s, reading, t);
      sum += t.distance * t.distance;
    }
    return std::sqrt(sum / static_cast<double>(readings_.size()));
  }

private:
  // Relative to the mean of the flange's positions, so that the robot's distance costs no precision.
  [[nodiscard]] Vector3d point(const State &s, const BeamReading &reading) const {
    return beam_point(s.beam, reading) - centre_;
  }

  // Algebraic fit: |p|^2 - 2 c . p = r^2 - |c|^2, about the mean.
  [[nodiscard]] State start_sphere(State out, const Vector3d &mean) const {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    for (const BeamReading &reading : readings_) {
      const Vector3d d = point(out, reading) - mean;
      const Eigen::Vector4d row(2.0 * d.x(), 2.0 * d.y(), 2.0 * d.z(), 1.0);
      normal += row * row.transpose();
      right += row * d.squaredNorm();
    }
    const Eigen::Vector4d x = normal.completeOrthogonalDecomposition().solve(right);
    const double squared = x[3] + x.head<3>().squaredNorm();
    out.body = mean + x.head<3>();
    out.size = options_.radius_mm.value_or(squared > 0.0 ? std::sqrt(squared) : kTypicalRadius_mm);
    return out;
  }

  std::span<const BeamReading> readings_;
  const BeamOptions &options_;
  Vector3d centre_ = Vector3d::Zero();
};

struct Descent {
  State state;
  double cost = std::numeric_limits<double>::infinity();
  bool settled = false;
};

Descent descend(const BeamProblem &problem, const Vector3d &direction) {
  Descent out;
  out.state = problem.start(direction);
  Eigen::MatrixXd normal;
  Eigen::VectorXd gradient;
  out.cost = problem.cost(out.state, &normal, &gradient);
  double damping = 1e-3;
  for (int step = 0; step < kBeamSteps && damping < 1e12; ++step) {
    Eigen::MatrixXd damped = normal;
    damped.diagonal() *= 1.0 + damping;
    const State next = problem.moved(out.state, -damped.ldlt().solve(gradient));
    const double cost = problem.cost(next);
    if (!(cost < out.cost)) {
      damping *= 10.0;
      // Where no step improves the cost any more, this is the minimum.
      out.settled = damping > 1e6 && std::isfinite(out.cost);
      continue;
    }
    out.settled = out.cost - cost < kSettled * out.cost;
    out.state = next;
    out.cost = problem.cost(next, &normal, &gradient);
    damping = std::max(1e-12, 0.1 * damping);
    if (out.settled) {
      break;
    }
  }
  return out;
}

template <class... Values> std::string beam_sentence(const char *pattern, Values... values) {
  char buffer[300];
  std::snprintf(buffer, sizeof buffer, pattern, values...);
  return buffer;
}

void settle(BeamResult &out, BeamVerdict verdict, std::string text) {
  out.verdict = verdict;
  out.text = (verdict == BeamVerdict::kAccepted ? "accepted: " : "refused: ") + std::move(text);
}

bool check_scan(std::span<const BeamReading> readings, const BeamOptions &options, BeamResult &out) {
  const auto valid = [](const BeamReading &r) {
    return r.T_base_flange.translation().allFinite() && r.T_base_flange.rotation().coeffs().allFinite() &&
           std::isfinite(r.range_mm) && r.range_mm > 0.0;
  };
  if (readings.size() < options.min_readings) {
    settle(out, BeamVerdict::kTooFewReadings,
           beam_sentence("%zu readings, at least %zu are needed", readings.size(), options.min_readings));
    return false;
  }
  if (!std::all_of(readings.begin(), readings.end(), valid)) {
    settle(out, BeamVerdict::kInvalidReading, "a pose is not finite or a range is not positive");
    return false;
  }
  std::vector<Eigen::Quaterniond> rotations;
  std::vector<double> ranges;
  for (const BeamReading &reading : readings) {
    rotations.push_back(reading.T_base_flange.rotation());
    ranges.push_back(reading.range_mm);
  }
  const auto turned = rotation_ranges(rotations);
  out.rotation_rad[0] = turned[0];
  out.rotation_rad[1] = turned[1];
  const auto percentile = [&ranges](double p) {
    const auto at = static_cast<std::ptrdiff_t>(p * static_cast<double>(ranges.size() - 1));
    std::nth_element(ranges.begin(), ranges.begin() + at, ranges.end());
    return ranges[static_cast<std::size_t>(at)];
  };
  out.range_change_mm = percentile(0.95) - percentile(0.05);
  constexpr double kDegrees = 1.0 / geometry::kRadiansPerDegree;
  if (turned[0] < std::max(kFixed_rad, options.min_rotation_rad)) {
    settle(out, BeamVerdict::kFixedOrientation,
           beam_sentence("the flange kept its orientation (it turned by %.1f degrees), so that an offset of the beam "
                         "vanishes into the body's place; at least %.0f degrees about two axes are needed",
                         kDegrees * turned[0], kDegrees * options.min_rotation_rad));
  } else if (turned[1] < options.min_rotation_rad) {
    settle(out, BeamVerdict::kOneAxis,
           beam_sentence("the flange was turned by %.0f degrees about one axis and by %.1f about the others; at least "
                         "%.0f about two axes are needed",
                         kDegrees * turned[0], kDegrees * turned[1], kDegrees * options.min_rotation_rad));
  } else if (out.range_change_mm < options.min_range_change_mm) {
    settle(
        out, BeamVerdict::kConstantRange,
        beam_sentence("the readings change by %.1f mm only, which leaves the beam's direction free; at least %.0f mm "
                      "are needed: scan from different distances",
                      out.range_change_mm, options.min_range_change_mm));
  } else {
    return true;
  }
  return false;
}

// Direction's rotation vector first, then the origin.
Matrix6d beam_covariance(const Eigen::MatrixXd &inverse, const Vector3d &direction) {
  Eigen::Matrix<double, 6, 5> to = Eigen::Matrix<double, 6, 5>::Zero();
  to.bottomLeftCorner<3, 3>().setIdentity();
  to.block<3, 1>(0, 3) = across(direction, 0);
  to.block<3, 1>(0, 4) = across(direction, 1);
  return to * inverse.topLeftCorner<5, 5>() * to.transpose();
}

} // namespace

BeamResult calibrate_beam(std::span<const BeamReading> readings, const BeamOptions &options) {
  BeamResult out;
  if (!check_scan(readings, options, out)) {
    return out;
  }
  const BeamProblem problem(readings, options);
  Descent best;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      const Descent found = descend(problem, sign * Vector3d::Unit(axis));
      if (found.cost < best.cost) {
        best = found;
      }
    }
  }
  if (!best.settled) {
    settle(out, BeamVerdict::kNotConverged, "no beam explains the readings");
    return out;
  }
  Eigen::MatrixXd normal;
  Eigen::VectorXd gradient;
  out.chi_square = problem.cost(best.state, &normal, &gradient);
  const Eigen::MatrixXd inverse = normal.ldlt().solve(Eigen::MatrixXd::Identity(normal.rows(), normal.cols()));
  out.estimated = true;
  out.beam = best.state.beam;
  out.covariance = beam_covariance(inverse, out.beam.direction);
  out.rms_mm = problem.rms_mm(best.state);
  const double dof = static_cast<double>(readings.size()) - static_cast<double>(problem.unknowns());
  out.p_value = uncertainty::chi_square_survival(out.chi_square, dof);
  const auto worst = [](const Matrix3d &m) {
    return std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix3d>(m).eigenvalues()[2]);
  };
  const double origin_mm = worst(out.covariance.bottomRightCorner<3, 3>());
  const double direction_rad = worst(out.covariance.topLeftCorner<3, 3>());
  const double direction_deg = direction_rad / geometry::kRadiansPerDegree;
  const double ratio = std::sqrt(out.chi_square / dof);
  if (!(origin_mm <= options.max_origin_sigma_mm) || !(direction_rad <= options.max_direction_sigma_rad)) {
    settle(out, BeamVerdict::kPoorlyObserved,
           beam_sentence("the scan determines the origin to %.1f mm and the direction to %.2f degrees (1 sigma, worst "
                         "direction): turn the flange further, scan from other distances",
                         origin_mm, direction_deg));
  } else if (!(out.p_value >= options.min_p_value)) {
    settle(out, BeamVerdict::kFitsBadly,
           beam_sentence("the points lie %.2f mm RMS off the body, %.1f times as far as the stated errors", out.rms_mm,
                         ratio));
  } else {
    settle(out, BeamVerdict::kAccepted,
           beam_sentence("origin known to %.2f mm, direction to %.3f degrees (1 sigma, worst direction); residuals "
                         "%.2f times the stated errors over %zu readings",
                         origin_mm, direction_deg, ratio, readings.size()));
  }
  return out;
}

Vector3d beam_point(const Beam &beam, const BeamReading &reading) {
  return reading.T_base_flange * (beam.origin_mm + reading.range_mm * beam.direction);
}

Matrix3d beam_point_covariance(const BeamResult &calibration, const BeamReading &reading, double range_sigma_mm,
                               double robot_sigma_mm) {
  const Matrix3d R = reading.T_base_flange.rotation_matrix();
  geometry::Matrix36d J;
  J.leftCols<3>() = -geometry::skew(reading.range_mm * calibration.beam.direction);
  J.rightCols<3>().setIdentity();
  const Vector3d along = R * calibration.beam.direction;
  return R * J * calibration.covariance * J.transpose() * R.transpose() +
         range_sigma_mm * range_sigma_mm * along * along.transpose() +
         robot_sigma_mm * robot_sigma_mm * Matrix3d::Identity();
}

} // namespace bregma::calibration
