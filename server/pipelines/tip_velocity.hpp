// Velocity of a tip: the least-squares slope over the positions of a short window. No allocation.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include <Eigen/Core>

namespace bregma::server {

class TipVelocity {
public:
  void reset() noexcept { count_ = 0; }

  // A time that is not after the last one tells nothing new and is passed over; what is older than the window is left
  // out.
  void add(const Eigen::Vector3d &position_mm, std::int64_t time_ns, std::int64_t window_ns) noexcept {
    if (count_ > 0 && time_ns <= samples_[newest_].time_ns) {
      return;
    }
    newest_ = (newest_ + 1) % kCapacity;
    samples_[newest_] = {position_mm, time_ns};
    count_ = count_ < kCapacity ? count_ + 1 : kCapacity;
    while (count_ > 0 && time_ns - samples_[oldest()].time_ns > window_ns) {
      --count_;
    }
  }

  // mm/s; NaN below three positions: what is not known is not zero.
  [[nodiscard]] Eigen::Vector3d mm_s() const noexcept {
    if (count_ < 3) {
      return Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    }
    const std::int64_t origin_ns = samples_[newest_].time_ns;
    double sum_t = 0.0;
    double sum_tt = 0.0;
    Eigen::Vector3d sum_x = Eigen::Vector3d::Zero();
    Eigen::Vector3d sum_tx = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < count_; ++i) {
      const Sample &sample = samples_[(newest_ + kCapacity - i) % kCapacity];
      const double t = 1e-9 * static_cast<double>(sample.time_ns - origin_ns);
      sum_t += t;
      sum_tt += t * t;
      sum_x += sample.position_mm;
      sum_tx += t * sample.position_mm;
    }
    const auto n = static_cast<double>(count_);
    return (n * sum_tx - sum_t * sum_x) / (n * sum_tt - sum_t * sum_t);
  }

private:
  static constexpr std::size_t kCapacity = 128;
  struct Sample {
    Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
    std::int64_t time_ns = 0;
  };
  [[nodiscard]] std::size_t oldest() const noexcept { return (newest_ + kCapacity + 1 - count_) % kCapacity; }

  std::array<Sample, kCapacity> samples_{};
  std::size_t newest_ = 0;
  std::size_t count_ = 0;
};

} // namespace bregma::server
