// Interface for the time, so that runs can be replayed and tests need no sleeps. docs/time.md explains the scales.
#pragma once

#include <atomic>
#include <cstdint>

#include "idl/host_clock.hpp"

namespace bregma::runtime {

// Threads: any. No function allocates, locks or throws.
class Clock {
public:
  virtual ~Clock() = default;
  // Steady UTC, ns since the Unix epoch. Steps of the wall clock do not change it.
  [[nodiscard]] std::int64_t now_ns() const noexcept { return boot_ns() + utc_minus_boot_ns(); }
  // Constant: the difference of the wall clock at the start.
  [[nodiscard]] virtual std::int64_t utc_minus_boot_ns() const noexcept = 0;
  [[nodiscard]] virtual std::int64_t monotonic_ns() const noexcept = 0; // never steps; for the deadlines of loops
  [[nodiscard]] virtual std::int64_t boot_ns() const noexcept = 0;      // never steps, and continues during suspend
  // The wall clock minus boot_ns(): constant except for steps of the wall clock.
  [[nodiscard]] virtual std::int64_t wall_minus_boot_ns() const noexcept = 0;
  // Maximal error of the wall clock, stated by the host's time service; 0: not synchronised.
  [[nodiscard]] virtual std::int64_t wall_error_ns() const noexcept = 0;
};

class SystemClock final : public Clock {
public:
  SystemClock() noexcept : utc_minus_boot_ns_(wire::wall_minus_boot_ns()) {}

  [[nodiscard]] std::int64_t utc_minus_boot_ns() const noexcept override { return utc_minus_boot_ns_; }
  [[nodiscard]] std::int64_t monotonic_ns() const noexcept override { return wire::monotonic_now_ns(); }
  [[nodiscard]] std::int64_t boot_ns() const noexcept override { return wire::boot_now_ns(); }
  [[nodiscard]] std::int64_t wall_minus_boot_ns() const noexcept override { return wire::wall_minus_boot_ns(); }
  [[nodiscard]] std::int64_t wall_error_ns() const noexcept override; // asks the system once per second

private:
  std::int64_t utc_minus_boot_ns_;
  mutable std::atomic<std::int64_t> ask_again_ns_{0}; // boot time
  mutable std::atomic<std::int64_t> wall_error_ns_{0};
};

class ManualClock final : public Clock {
public:
  explicit ManualClock(std::int64_t now_ns = 0) : utc_minus_boot_ns_(now_ns), wall_minus_boot_ns_(now_ns) {}
  [[nodiscard]] std::int64_t utc_minus_boot_ns() const noexcept override { return utc_minus_boot_ns_; }
  [[nodiscard]] std::int64_t monotonic_ns() const noexcept override { return boot_ns(); }
  [[nodiscard]] std::int64_t boot_ns() const noexcept override { return boot_ns_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::int64_t wall_minus_boot_ns() const noexcept override {
    return wall_minus_boot_ns_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::int64_t wall_error_ns() const noexcept override { return 0; }
  void advance(std::int64_t duration_ns) noexcept { boot_ns_.fetch_add(duration_ns, std::memory_order_relaxed); }
  void step_wall_clock(std::int64_t by_ns) noexcept { wall_minus_boot_ns_.fetch_add(by_ns, std::memory_order_relaxed); }

private:
  std::int64_t utc_minus_boot_ns_;
  std::atomic<std::int64_t> wall_minus_boot_ns_;
  std::atomic<std::int64_t> boot_ns_{0};
};

} // namespace bregma::runtime
