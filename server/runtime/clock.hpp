// Interface for the time, so that runs can be replayed and tests need no sleeps.
#pragma once

#include <atomic>
#include <cstdint>

namespace bregma::runtime {

// Threads: any. Neither function allocates, locks or throws.
class Clock {
public:
  virtual ~Clock() = default;
  [[nodiscard]] virtual std::int64_t now_ns() const noexcept = 0;       // UTC, since the Unix epoch
  [[nodiscard]] virtual std::int64_t monotonic_ns() const noexcept = 0; // never steps; for durations and deadlines
  [[nodiscard]] virtual std::int64_t boot_ns() const noexcept = 0;      // never steps, and continues during suspend
};

class SystemClock final : public Clock {
public:
  [[nodiscard]] std::int64_t now_ns() const noexcept override;
  [[nodiscard]] std::int64_t monotonic_ns() const noexcept override;
  [[nodiscard]] std::int64_t boot_ns() const noexcept override;
};

class ManualClock final : public Clock {
public:
  explicit ManualClock(std::int64_t now_ns = 0) : now_ns_(now_ns) {}
  [[nodiscard]] std::int64_t now_ns() const noexcept override { return now_ns_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::int64_t monotonic_ns() const noexcept override {
    return monotonic_ns_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::int64_t boot_ns() const noexcept override { return monotonic_ns(); }
  void advance(std::int64_t duration_ns) noexcept {
    now_ns_.fetch_add(duration_ns, std::memory_order_relaxed);
    monotonic_ns_.fetch_add(duration_ns, std::memory_order_relaxed);
  }
  // Steps UTC alone, as NTP may do.
  void step_utc(std::int64_t by_ns) noexcept { now_ns_.fetch_add(by_ns, std::memory_order_relaxed); }

private:
  std::atomic<std::int64_t> now_ns_;
  std::atomic<std::int64_t> monotonic_ns_{0};
};

} // namespace bregma::runtime
