// Simulated devices for hand-eye and beam calibration, and the coverage of their covariances: for the benchmark and the
// tests.
#pragma once

#include <array>
#include <random>
#include <vector>

#include "algorithms/calibration/beam.hpp"
#include "algorithms/calibration/hand_eye.hpp"

namespace bregma::bench {

struct Coverage {
  double percent_within = 0.0; // of the runs, inside the 95 % region
  int refused = 0;
  double rms_position_mm = 0.0; // of X, or of the beam's origin
  double rms_rotation_rad = 0.0;
};

// A robot that turns its flange in front of a tracker, which sees a body on the flange.
struct HandEyeScene {
  calibration::HandEyePose X{Eigen::Quaterniond(0.8, 0.3, -0.4, 0.3), {20.0, -35.0, 90.0}};
  calibration::HandEyePose Y{Eigen::Quaterniond(0.2, -0.6, 0.7, 0.3), {150.0, -300.0, 1400.0}};
  std::array<double, 3> turn_rad{0.6, 0.6, 0.6}; // largest rotation vector, in the flange
  calibration::HandEyeOptions options;

  // Poses of the same instants with the stated noise of both devices.
  [[nodiscard]] std::vector<calibration::HandEyePair> poses(std::size_t count, std::mt19937 &rng) const;
  // Motions with independent noise.
  [[nodiscard]] std::vector<calibration::HandEyePair> motions(std::size_t count, std::mt19937 &rng) const;
};
[[nodiscard]] Coverage hand_eye_coverage(const HandEyeScene &scene, bool absolute, std::size_t count, int runs,
                                         unsigned seed);

// A sensor on the flange that scans a plane, or a sphere on it, from several orientations.
struct BeamScene {
  calibration::Beam beam{{12.0, -8.0, 45.0}, Eigen::Vector3d(0.03, -0.05, 1.0).normalized()};
  std::array<double, 3> turn_rad{0.4, 0.4, 0.4};
  std::array<double, 2> range_mm{120.0, 250.0}; // of the flange's height, or of the reading itself (at_range)
  bool at_range = false;
  double noise_factor = 1.0; // of the readings, over what is stated
  calibration::BeamOptions options;

  [[nodiscard]] std::vector<calibration::BeamReading> readings(std::size_t count, std::mt19937 &rng) const;
};
[[nodiscard]] Coverage beam_coverage(const BeamScene &scene, std::size_t count, int runs, unsigned seed);

} // namespace bregma::bench
