// Motion of a hand-held tool: smooth paths plus tremor.
//
// A movement gives the intended pose of the tip at a time since its start. It begins and ends at rest, so that
// movements can be concatenated. Positions and orientations are at least once continuously differentiable. Poses are
// those of the tool's tip (axes of the tool, origin at the true tip) in Image, mm. Only Tremor is random.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::sim {

using Eigen::Quaterniond;
using geometry::Vector3d;

// freedom: fraction of the hand's tremor that reaches the tool. 1 in the air; less for the position if the tip rests on
// a surface; 0 in a stand.
struct HandPose {
  Vector3d tip_mm = Vector3d::Zero();
  Quaterniond rotation = Quaterniond::Identity();
  double position_freedom = 0.0;
  double rotation_freedom = 0.0;
};

class Movement {
public:
  virtual ~Movement() = default;
  [[nodiscard]] virtual double duration_s() const = 0;
  // Before the start and after the end: the first and the last pose.
  [[nodiscard]] virtual HandPose at(double since_start_s) const = 0;
};

// Fraction of the path of a minimum-jerk movement at the fraction u of its time: 10 u^3 - 15 u^4 + 6 u^5
// [Flash 1985].
[[nodiscard]] double minimum_jerk(double u);

// A curved path from one pose to another, around an obstacle.
class Reach final : public Movement {
public:
  Reach(const HandPose &from, const HandPose &to, double mean_speed_mm_s, const Vector3d &bow_mm = Vector3d::Zero());
  [[nodiscard]] double duration_s() const override { return duration_s_; }
  [[nodiscard]] HandPose at(double since_start_s) const override;
  [[nodiscard]] Vector3d position(double way) const; // way from 0 to 1

private:
  HandPose from_, to_;
  Vector3d bow_;
  double duration_s_;
};

// Constant speed along a uniform cubic B-spline of closely spaced poses, with a smooth start and stop. A B-spline
// approximates: with knots h apart on a radius R the deviation is h^2 / 6R.
class Glide final : public Movement {
public:
  Glide(std::vector<HandPose> knots, double speed_mm_s);
  [[nodiscard]] double duration_s() const override { return duration_s_; }
  [[nodiscard]] HandPose at(double since_start_s) const override;
  [[nodiscard]] double length_mm() const { return length_mm_; }

private:
  std::vector<HandPose> knots_; // ends tripled
  double length_mm_ = 0.0;
  double ramp_s_ = 0.0;
  double duration_s_ = 0.0;
};

// Rotates about a tip that rests in a dimple: two axes normal to the tool's with different frequencies, and slight
// spin.
class Swing final : public Movement {
public:
  struct Amplitude {
    Vector3d axis; // in Image
    double angle_rad;
    double frequency_hz;
  };
  Swing(const HandPose &rest, const std::array<Amplitude, 3> &amplitudes, double duration_s);
  [[nodiscard]] double duration_s() const override { return duration_s_; }
  [[nodiscard]] HandPose at(double since_start_s) const override;

private:
  HandPose rest_;
  std::array<Amplitude, 3> amplitudes_;
  double duration_s_;
};

// Physiological tremor (8 to 12 Hz) and slow wander (below 0.7 Hz) of six coordinates. Each is a sum of sines, which is
// stationary, smooth and a function of time only.
class Tremor {
public:
  struct Strength {
    double tremor_mm, tremor_rad, wander_mm, wander_rad; // standard deviation per coordinate
  };
  Tremor(const Strength &strength, std::uint64_t seed, std::string_view hand);
  [[nodiscard]] HandPose applied(const HandPose &meant, double time_s) const;

private:
  struct Sine {
    double amplitude, frequency_rad_s, phase;
  };
  static constexpr std::size_t kSines = 6; // per coordinate: three of tremor, three of wander
  std::array<std::array<Sine, kSines>, 6> coordinates_;
};

} // namespace bregma::sim
