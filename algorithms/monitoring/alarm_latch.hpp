// Hysteresis of an alarm: raised when its condition has held for a given time, cleared when it has been absent for a
// given time. Time is an argument. No allocation, one thread at a time.
#pragma once

#include <cstdint>

namespace bregma::monitoring {

class AlarmLatch {
public:
  enum class Change { kNone, kRaised, kCleared };

  // raise_after_ns 0: at once. raise_after_count: consecutive updates with a true condition, in addition to the time.
  // clear_after_ns < 0: never clears by itself.
  AlarmLatch(std::int64_t raise_after_ns, std::int64_t clear_after_ns, int raise_after_count = 1) noexcept
      : raise_after_ns_(raise_after_ns), clear_after_ns_(clear_after_ns), raise_after_count_(raise_after_count) {}

  Change update(bool condition, std::int64_t now_ns) noexcept {
    if (condition != last_ || !started_) {
      started_ = true;
      last_ = condition;
      since_ns_ = now_ns;
      count_ = 0;
    }
    ++count_;
    const std::int64_t held_ns = now_ns - since_ns_;
    if (condition && !raised_ && count_ >= raise_after_count_ && held_ns >= raise_after_ns_) {
      raised_ = true;
      return Change::kRaised;
    }
    if (!condition && raised_ && clear_after_ns_ >= 0 && held_ns >= clear_after_ns_) {
      raised_ = false;
      return Change::kCleared;
    }
    return Change::kNone;
  }

  [[nodiscard]] bool raised() const noexcept { return raised_; }
  void reset() noexcept { *this = AlarmLatch(raise_after_ns_, clear_after_ns_, raise_after_count_); }

private:
  std::int64_t raise_after_ns_;
  std::int64_t clear_after_ns_;
  int raise_after_count_;
  std::int64_t since_ns_ = 0;
  int count_ = 0;
  bool last_ = false;
  bool started_ = false;
  bool raised_ = false;
};

} // namespace bregma::monitoring
