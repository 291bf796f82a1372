#include "drivers/sim/motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/sim/random.hpp"

namespace bregma::sim {

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kTurnSpeed_rad_s = 1.2;
constexpr double kMinDuration_s = 0.3;
constexpr double kRamp_s = 0.6;

double mix(double a, double b, double way) { return a + (b - a) * way; }

double bowed_length(const Vector3d &from, const Vector3d &to, const Vector3d &bow) {
  const double straight = (to - from).norm();
  // Length of a half sine, accurate enough for a duration.
  return std::hypot(straight, 2.2 * bow.norm());
}

// Integral of the smooth step 3u^2 - 2u^3.
double ramp_way(double u) { return u * u * u - 0.5 * u * u * u * u; }

} // namespace

double minimum_jerk(double u) {
  const double x = std::clamp(u, 0.0, 1.0);
  return x * x * x * (10.0 + x * (-15.0 + 6.0 * x));
}

Reach::Reach(const HandPose &from, const HandPose &to, double mean_speed_mm_s, const Vector3d &bow_mm)
    : from_(from), to_(to), bow_(bow_mm),
      duration_s_(std::max({kMinDuration_s, bowed_length(from.tip_mm, to.tip_mm, bow_mm) / mean_speed_mm_s,
                            geometry::angle_between(from.rotation, to.rotation) / kTurnSpeed_rad_s})) {}

Vector3d Reach::position(double way) const {
  return from_.tip_mm + way * (to_.tip_mm - from_.tip_mm) + std::sin(kPi * way) * bow_;
}

HandPose Reach::at(double since_start_s) const {
  const double way = minimum_jerk(since_start_s / duration_s_);
  return {position(way), from_.rotation.slerp(way, to_.rotation),
          mix(from_.position_freedom, to_.position_freedom, way),
          mix(from_.rotation_freedom, to_.rotation_freedom, way)};
}

Glide::Glide(std::vector<HandPose> knots, double speed_mm_s) : knots_(std::move(knots)) {
  for (std::size_t i = 1; i < knots_.size(); ++i) {
    length_mm_ += (knots_[i].tip_mm - knots_[i - 1].tip_mm).norm();
    if (knots_[i].rotation.dot(knots_[i - 1].rotation) < 0.0) {
      knots_[i].rotation.coeffs() *= -1.0; // the same rotation, with the sign that a weighted mean needs
    }
  }
  knots_.insert(knots_.begin(), 2, HandPose(knots_.front()));
  knots_.insert(knots_.end(), 2, HandPose(knots_.back()));
  ramp_s_ = std::min(kRamp_s, length_mm_ / speed_mm_s);
  duration_s_ = length_mm_ / speed_mm_s + ramp_s_; // each ramp covers half the distance of constant speed
}

HandPose Glide::at(double since_start_s) const {
  const double t = std::clamp(since_start_s, 0.0, duration_s_);
  const double from_end = duration_s_ - t;
  const double even_s = duration_s_ - ramp_s_; // time at constant speed
  double way = (t - 0.5 * ramp_s_) / even_s;
  if (t < ramp_s_) {
    way = ramp_s_ * ramp_way(t / ramp_s_) / even_s;
  } else if (from_end < ramp_s_) {
    way = 1.0 - ramp_s_ * ramp_way(from_end / ramp_s_) / even_s;
  }
  const auto spans = static_cast<double>(knots_.size() - 3);
  const double u = std::clamp(way, 0.0, 1.0) * spans;
  const auto first = static_cast<std::size_t>(std::min(std::floor(u), spans - 1.0));
  const double x = u - static_cast<double>(first);
  const double back = 1.0 - x;
  const std::array<double, 4> weights{back * back * back / 6.0, (3 * x * x * x - 6 * x * x + 4) / 6.0,
                                      (-3 * x * x * x + 3 * x * x + 3 * x + 1) / 6.0, x * x * x / 6.0};
  HandPose out;
  out.rotation.coeffs().setZero();
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const HandPose &knot = knots_[first + i];
    out.tip_mm += weights[i] * knot.tip_mm;
    out.rotation.coeffs() += weights[i] * knot.rotation.coeffs();
    out.position_freedom += weights[i] * knot.position_freedom;
    out.rotation_freedom += weights[i] * knot.rotation_freedom;
  }
  out.rotation.normalize();
  return out;
}

Swing::Swing(const HandPose &rest, const std::array<Amplitude, 3> &amplitudes, double duration_s)
    : rest_(rest), amplitudes_(amplitudes), duration_s_(duration_s) {}

HandPose Swing::at(double since_start_s) const {
  const double t = std::clamp(since_start_s, 0.0, duration_s_);
  const double envelope = minimum_jerk(t / 1.0) * minimum_jerk((duration_s_ - t) / 1.0);
  Vector3d turn = Vector3d::Zero();
  for (const Amplitude &amplitude : amplitudes_) {
    turn += envelope * amplitude.angle_rad * std::sin(2.0 * kPi * amplitude.frequency_hz * t) * amplitude.axis;
  }
  HandPose out = rest_;
  out.rotation = geometry::rotation_exp(turn) * rest_.rotation;
  return out;
}

Tremor::Tremor(const Strength &strength, std::uint64_t seed, std::string_view hand) : coordinates_{} {
  Random random(seed, hand);
  for (std::size_t c = 0; c < coordinates_.size(); ++c) {
    const double tremor = c < 3 ? strength.tremor_mm : strength.tremor_rad;
    const double wander = c < 3 ? strength.wander_mm : strength.wander_rad;
    for (std::size_t i = 0; i < kSines; ++i) {
      const bool slow = i >= kSines / 2;
      const double frequency = slow ? random.uniform(0.1, 0.7) : random.uniform(8.0, 12.0);
      // n sines of amplitude a have the variance n a^2 / 2.
      const double amplitude = (slow ? wander : tremor) * std::sqrt(2.0 / (kSines / 2.0));
      coordinates_[c][i] = {amplitude, 2.0 * kPi * frequency, random.uniform(0.0, 2.0 * kPi)};
    }
  }
}

HandPose Tremor::applied(const HandPose &meant, double time_s) const {
  if (meant.position_freedom == 0.0 && meant.rotation_freedom == 0.0) {
    return meant;
  }
  std::array<double, 6> unrest{};
  for (std::size_t c = 0; c < unrest.size(); ++c) {
    for (const Sine &sine : coordinates_[c]) {
      unrest[c] += sine.amplitude * std::sin(sine.frequency_rad_s * time_s + sine.phase);
    }
  }
  HandPose out = meant;
  out.tip_mm += meant.position_freedom * Vector3d(unrest[0], unrest[1], unrest[2]);
  out.rotation =
      geometry::rotation_exp(meant.rotation_freedom * Vector3d(unrest[3], unrest[4], unrest[5])) * meant.rotation;
  return out;
}

} // namespace bregma::sim
