// The latest poses of a body that is measured at intervals, and its pose at a time between two of them.
//
// The rotation is interpolated on the sphere, the position linearly. The covariance is that of the later measurement
// with the way that the body goes in the uncertainty of its time. Where the measurements have a gap nothing is known.
//
// Times ns UTC of the host, rising. One thread. No allocation, no exceptions.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::server {

// Between two measurements, a longer time is a gap.
[[nodiscard]] inline std::int64_t max_gap_ns(std::int64_t period_ns) noexcept {
  constexpr std::int64_t kPeriods = 3;
  constexpr std::int64_t kShortest_ns = 20'000'000;
  return std::max(kPeriods * period_ns, kShortest_ns);
}

template <class Target, class Source, std::size_t Capacity> class PoseHistory {
public:
  using Pose = geometry::UncertainPose<Target, Source>;
  struct Sample {
    std::int64_t time_ns = 0;
    std::int64_t sigma_ns = 0; // 1 sigma of that time
    std::int64_t period_ns = 0;
    Pose T;
  };

  void clear() noexcept { count_ = 0; }
  // One that is not later than the last is ignored; if there is no room the oldest is forgotten.
  void add(const Sample &sample) noexcept {
    if (count_ > 0 && sample.time_ns <= newest()->time_ns) {
      return;
    }
    if (count_ == Capacity) {
      first_ = (first_ + 1) % Capacity;
      --count_;
    }
    samples_[(first_ + count_) % Capacity] = sample;
    ++count_;
  }
  [[nodiscard]] const Sample *newest() const noexcept { return count_ == 0 ? nullptr : &from_newest(0); }
  // A measurement of this time or later has come: what at() says is final.
  [[nodiscard]] bool reaches(std::int64_t time_ns) const noexcept { return count_ > 0 && newest()->time_ns >= time_ns; }

  // nullopt: outside the measurements, or in a gap.
  [[nodiscard]] std::optional<Pose> at(std::int64_t time_ns) const noexcept {
    if (!reaches(time_ns)) {
      return std::nullopt;
    }
    std::size_t i = 0;
    while (i + 1 < count_ && from_newest(i + 1).time_ns >= time_ns) {
      ++i;
    }
    if (i + 1 == count_) {
      return std::nullopt;
    }
    const Sample &after = from_newest(i);
    const Sample &before = from_newest(i + 1);
    const std::int64_t whole_ns = after.time_ns - before.time_ns;
    if (whole_ns > max_gap_ns(after.period_ns)) {
      return std::nullopt;
    }
    const double fraction = static_cast<double>(time_ns - before.time_ns) / static_cast<double>(whole_ns);
    const auto &a = before.T.pose;
    const auto &b = after.T.pose;
    const auto moved = b * a.inverse();
    geometry::Vector6d way; // in the uncertainty of the time
    way << geometry::rotation_log(moved.rotation()), moved.translation();
    way *= static_cast<double>(after.sigma_ns) / static_cast<double>(whole_ns);
    return Pose{{a.rotation().slerp(fraction, b.rotation()),
                 geometry::Vector3d((1.0 - fraction) * a.translation() + fraction * b.translation())},
                after.T.covariance + way * way.transpose()};
  }

private:
  [[nodiscard]] const Sample &from_newest(std::size_t index) const noexcept {
    return samples_[(first_ + count_ - 1 - index) % Capacity];
  }

  std::array<Sample, Capacity> samples_;
  std::size_t first_ = 0;
  std::size_t count_ = 0;
};

} // namespace bregma::server
