#include "server/runtime/clock.hpp"

namespace bregma::runtime {

std::int64_t SystemClock::wall_error_ns() const noexcept {
  constexpr std::int64_t kAskEvery_ns = 1'000'000'000;
  const std::int64_t now_ns = boot_ns();
  std::int64_t due_ns = ask_again_ns_.load(std::memory_order_relaxed);
  if (now_ns >= due_ns &&
      ask_again_ns_.compare_exchange_strong(due_ns, now_ns + kAskEvery_ns, std::memory_order_relaxed)) {
    wall_error_ns_.store(wire::wall_clock_error_ns(), std::memory_order_relaxed);
  }
  return wall_error_ns_.load(std::memory_order_relaxed);
}

} // namespace bregma::runtime
