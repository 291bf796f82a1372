// Where the tracked reference of a patient is in the base of an arm: the mean of the latest frames. A single frame has
// an error of a millimetre at the far side of the head, by its turn; the mean has a fourth of it.
//
// The mean is exponential, of all samples until kGain is reached. It begins anew when the reference was not usable, and
// with a sample that is farther away than noise: a patient who moves fast is where the last frame saw him. A sample
// after hidden frames has their weight too, so that the mean follows as fast as it does without them.
//
// RobotBase, mm, rad. One thread. No allocation, no exceptions.
#pragma once

#include <algorithm>
#include <cmath>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::server {

class PatientPlace {
public:
  using Pose = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::Reference>;
  static constexpr double kGain = 0.15;
  static constexpr double kJump_mm = 5.0, kJump_rad = 0.05;
  static constexpr int kSettled = 10; // samples

  void reset() noexcept { count_ = 0; }
  // frames: since the last sample, at least 1.
  void add(const Pose &sample, int frames = 1) noexcept {
    const geometry::Vector3d way = sample.translation() - mean_.translation();
    const geometry::Vector3d turn = geometry::rotation_log(sample.rotation() * mean_.rotation().conjugate());
    if (count_ == 0 || !(way.norm() <= kJump_mm) || !(turn.norm() <= kJump_rad)) {
      mean_ = sample;
      count_ = 1;
      return;
    }
    ++count_;
    const double gain = std::max(1.0 - std::pow(1.0 - kGain, std::max(frames, 1)), 1.0 / count_);
    mean_ = {geometry::rotation_exp(gain * turn) * mean_.rotation(), mean_.translation() + gain * way};
    count_ = std::min(count_, kSettled);
  }
  [[nodiscard]] bool known() const noexcept { return count_ > 0; }
  // A mean that a path can be planned by.
  [[nodiscard]] bool settled() const noexcept { return count_ >= kSettled; }
  [[nodiscard]] const Pose &mean() const noexcept { return mean_; }

private:
  Pose mean_;
  int count_ = 0; // samples since it began; at most kSettled
};

} // namespace bregma::server
