// Motion of one tracked body from successive frames: tests whether a body can have moved from where it was to where a
// frame shows it.
//
// A Kalman filter of one point with constant velocity. Its process noise is the acceleration of a fast hand, which
// moves at up to 2 m/s, so at 60 Hz and more it excludes what no hand does. All covariances are isotropic with the
// largest variance of any direction, so the test is conservative. A rotation is tested against the angular speed of a
// hand.
//
// One thread. No allocation, no exceptions.
#pragma once

#include <algorithm>
#include <cstdint>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::server {

// A body in one frame: a point on it, far from its markers if possible, so that the point shows rotations too.
struct BodySample {
  std::int64_t time_ns = 0; // exposure
  geometry::Vector3d point_mm = geometry::Vector3d::Zero();
  double variance_mm2 = 0.0; // of the point: trace of its covariance
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  double rotation_variance = 0.0; // rad^2: trace of its covariance
};

// How far a sample is from what the track allows, as squared distances relative to their variance.
struct Motion {
  // An excluded motion exceeds this: 6 sigma.
  static constexpr double kThreshold = 36.0;

  double moved = 0.0;
  double turned = 0.0;

  [[nodiscard]] double statistic() const noexcept { return std::max(moved, turned); }
  // NaN too.
  [[nodiscard]] bool excluded() const noexcept { return !(moved <= kThreshold && turned <= kThreshold); }
};

class BodyTrack {
public:
  static constexpr double kMaxSpeed_mm_s = 2000.0; // of a hand
  // A body that was not seen for longer can be anywhere.
  static constexpr std::int64_t kForgotten_ns = 1'000'000'000;
  // Displacements of a body at rest that the scatter of its markers does not explain and that still mean nothing.
  static constexpr double kRest_mm = 5.0;
  static constexpr double kRest_rad = 0.05;

  void reset() noexcept { started_ = false; }
  [[nodiscard]] bool knows(std::int64_t time_ns) const noexcept {
    return started_ && time_ns - last_.time_ns <= kForgotten_ns;
  }
  [[nodiscard]] std::int64_t unseen_ns(std::int64_t time_ns) const noexcept {
    return started_ ? time_ns - last_.time_ns : 0;
  }
  // Motion to a sample after the last one, relative to that of a hand. Precondition: knows() its time.
  [[nodiscard]] Motion by_hand(const BodySample &sample) const noexcept;
  // The same relative to a body that has rested, however long it was not seen. Precondition: unseen_ns() > 0.
  [[nodiscard]] Motion from_rest(const BodySample &sample) const noexcept;
  // Starts with a sample, of which nothing else is known.
  void start(const BodySample &sample) noexcept;
  // Takes a sample that has passed the test.
  void update(const BodySample &sample) noexcept;
  [[nodiscard]] const BodySample &last() const noexcept { return last_; }

private:
  struct State {
    geometry::Vector3d position_mm = geometry::Vector3d::Zero();
    geometry::Vector3d velocity_mm_s = geometry::Vector3d::Zero();
    double pp = 0.0, pv = 0.0, vv = 0.0; // covariance of a coordinate
  };
  [[nodiscard]] State predicted(std::int64_t time_ns) const noexcept;

  bool started_ = false;
  BodySample last_;
  State state_;
};

} // namespace bregma::server
