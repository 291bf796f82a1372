#include "bench/robot/calibration_scenes.hpp"

#include <cmath>
#include <optional>

#include <Eigen/Dense>

#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::bench {

namespace {

using calibration::BeamReading;
using calibration::HandEyePair;
using calibration::HandEyePose;
using Eigen::Vector3d;
using geometry::Vector6d;
using Frame = geometry::Rigid3<geometry::frame::Target, geometry::frame::Target>;

constexpr double kSphereRadius_mm = 60.0;

Frame plain_frame(const HandEyePose &T) { return T.as<geometry::frame::Target, geometry::frame::Target>(); }
HandEyePose named(const Frame &T) { return T.as<geometry::frame::Target, geometry::frame::Source>(); }

Vector3d gaussian(std::mt19937 &rng, double sigma) {
  std::normal_distribution<double> normal(0.0, sigma);
  const double x = normal(rng);
  const double y = normal(rng);
  const double z = normal(rng);
  return {x, y, z};
}

Vector3d within(std::mt19937 &rng, const Vector3d &reach) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const double x = unit(rng);
  const double y = unit(rng);
  const double z = unit(rng);
  return reach.cwiseProduct(Vector3d(x, y, z));
}

Vector3d vector_of(const std::array<double, 3> &a) { return {a[0], a[1], a[2]}; }

// The pose as a device reports it.
Frame measured(const Frame &T, const calibration::PoseNoise &noise, std::mt19937 &rng) {
  const Eigen::Quaterniond turn = geometry::rotation_exp(gaussian(rng, noise.rotation_rad));
  return {turn * T.rotation(), T.translation() + gaussian(rng, noise.position_mm)};
}

Frame flange_pose(const std::array<double, 3> &turn_rad, std::mt19937 &rng) {
  const Eigen::Quaterniond down(0.0, 1.0, 0.0, 0.0); // looks down
  const Eigen::Quaterniond turn = geometry::rotation_exp(within(rng, vector_of(turn_rad)));
  return {down * turn, Vector3d(400.0, 0.0, 500.0) + within(rng, {150.0, 150.0, 100.0})};
}

// Twist that takes the estimate to the truth.
Vector6d error_of(const HandEyePose &truth, const HandEyePose &estimate) {
  const Frame T = plain_frame(truth) * plain_frame(estimate).inverse();
  Vector6d out;
  // The translation of the group logarithm, to second order in the rotation.
  const Vector3d w = geometry::rotation_log(T.rotation());
  out << w, T.translation() - 0.5 * w.cross(T.translation());
  return out;
}

} // namespace

std::vector<HandEyePair> HandEyeScene::poses(std::size_t count, std::mt19937 &rng) const {
  std::vector<HandEyePair> out;
  for (std::size_t i = 0; i < count; ++i) {
    const Frame A = flange_pose(turn_rad, rng);
    const Frame B = plain_frame(Y).inverse() * A * plain_frame(X);
    out.push_back({named(measured(A, options.robot, rng)), named(measured(B, options.tracker, rng))});
  }
  return out;
}

std::vector<HandEyePair> HandEyeScene::motions(std::size_t count, std::mt19937 &rng) const {
  std::vector<HandEyePair> out;
  for (std::size_t i = 0; i < count; ++i) {
    const Frame A = flange_pose(turn_rad, rng).inverse() * flange_pose(turn_rad, rng);
    const Frame B = plain_frame(X).inverse() * A * plain_frame(X);
    out.push_back({named(measured(A, options.robot, rng)), named(measured(B, options.tracker, rng))});
  }
  return out;
}

Coverage hand_eye_coverage(const HandEyeScene &scene, bool absolute, std::size_t count, int runs, unsigned seed) {
  std::mt19937 rng(seed);
  Coverage out;
  int within_region = 0;
  double position = 0.0;
  double rotation = 0.0;
  const Eigen::Index free = absolute ? 12 : 6;
  const double region = uncertainty::chi_square_upper_quantile(0.05, static_cast<double>(free));
  for (int run = 0; run < runs; ++run) {
    const auto result = absolute ? calibration::calibrate_hand_eye(scene.poses(count, rng), scene.options)
                                 : calibration::calibrate_hand_eye_motions(scene.motions(count, rng), scene.options);
    if (!result.accepted()) {
      ++out.refused;
      continue;
    }
    Eigen::VectorXd error(12);
    error << error_of(scene.X, result.X), error_of(scene.Y, result.Y);
    const Eigen::MatrixXd covariance = result.joint.topLeftCorner(free, free);
    within_region += error.head(free).dot(covariance.ldlt().solve(error.head(free))) <= region ? 1 : 0;
    position += (scene.X.translation() - result.X.translation()).squaredNorm();
    rotation += error.head<3>().squaredNorm();
  }
  out.percent_within = 100.0 * within_region / runs;
  out.rms_position_mm = std::sqrt(position / runs);
  out.rms_rotation_rad = std::sqrt(rotation / runs);
  return out;
}

std::vector<BeamReading> BeamScene::readings(std::size_t count, std::mt19937 &rng) const {
  std::vector<BeamReading> out;
  const bool plane = options.body == calibration::BeamBody::kPlane;
  const Vector3d centre(400.0, 0.0, 20.0);
  const Vector3d normal = Vector3d(0.05, -0.02, 1.0).normalized();
  std::uniform_real_distribution<double> height(range_mm[0], range_mm[1]);
  std::normal_distribution<double> noise(0.0, noise_factor * options.range_sigma_mm);
  while (out.size() < count) {
    const Eigen::Quaterniond down(0.0, 1.0, 0.0, 0.0);
    const Eigen::Quaterniond R = down * geometry::rotation_exp(within(rng, vector_of(turn_rad)));
    const Vector3d u = R * beam.direction;
    const double wanted = height(rng);
    // The flange so that the beam meets the body near its middle.
    const double spread = plane ? 150.0 : 0.6 * kSphereRadius_mm;
    const Vector3d aim =
        centre + within(rng, {spread, spread, 0.0}) + Vector3d(0.0, 0.0, plane ? 0.0 : kSphereRadius_mm);
    const Vector3d foot = aim - wanted * u;
    std::optional<double> range;
    if (plane) {
      range = normal.dot(centre - foot) / normal.dot(u);
    } else {
      const Vector3d to = centre - foot;
      const double along = u.dot(to);
      const double rest = along * along - to.squaredNorm() + kSphereRadius_mm * kSphereRadius_mm;
      range = rest > 0.0 ? std::optional(along - std::sqrt(rest)) : std::nullopt;
    }
    if (!range || *range <= 0.0) {
      continue;
    }
    Vector3d base = foot;
    double reading = *range;
    if (at_range) { // move the flange along the beam
      base += (*range - wanted) * u;
      reading = wanted;
    }
    const Vector3d t = base - R * beam.origin_mm + gaussian(rng, options.robot_sigma_mm);
    out.push_back({calibration::BeamFlange(R, t), reading + noise(rng)});
  }
  return out;
}

Coverage beam_coverage(const BeamScene &scene, std::size_t count, int runs, unsigned seed) {
  std::mt19937 rng(seed);
  Coverage out;
  int within_region = 0;
  double position = 0.0;
  double rotation = 0.0;
  const double region = uncertainty::chi_square_upper_quantile(0.05, 5.0);
  for (int run = 0; run < runs; ++run) {
    const auto result = calibration::calibrate_beam(scene.readings(count, rng), scene.options);
    if (!result.accepted()) {
      ++out.refused;
      continue;
    }
    Vector6d error;
    error << result.beam.direction.cross(scene.beam.direction), scene.beam.origin_mm - result.beam.origin_mm;
    // The direction has two degrees of freedom.
    const Eigen::Matrix<double, 6, 6> inverse = result.covariance.completeOrthogonalDecomposition().pseudoInverse();
    within_region += error.dot(inverse * error) <= region ? 1 : 0;
    position += error.tail<3>().squaredNorm();
    rotation += error.head<3>().squaredNorm();
  }
  out.percent_within = 100.0 * within_region / runs;
  out.rms_position_mm = std::sqrt(position / runs);
  out.rms_rotation_rad = std::sqrt(rotation / runs);
  return out;
}

} // namespace bregma::bench
