#include "idl/host_clock.hpp"

#include <algorithm>
#include <ctime>
#include <limits>

#include <sys/timex.h>

namespace bregma::wire {
namespace {

constexpr int kAttempts = 5;
constexpr std::int64_t kCloseTogether_ns = 5'000;

std::int64_t read(clockid_t clock) noexcept {
  timespec time{};
  clock_gettime(clock, &time);
  return static_cast<std::int64_t>(time.tv_sec) * 1'000'000'000 + time.tv_nsec;
}

} // namespace

std::int64_t monotonic_now_ns() noexcept { return read(CLOCK_MONOTONIC); }

std::int64_t wall_minus_boot_ns() noexcept {
  std::int64_t narrowest_ns = std::numeric_limits<std::int64_t>::max();
  std::int64_t out = 0;
  for (int i = 0; i < kAttempts && narrowest_ns > kCloseTogether_ns; ++i) {
    const std::int64_t before_ns = boot_now_ns();
    const std::int64_t wall_ns = read(CLOCK_REALTIME);
    const std::int64_t between_ns = boot_now_ns() - before_ns;
    if (between_ns < narrowest_ns) {
      narrowest_ns = between_ns;
      out = wall_ns - before_ns - between_ns / 2;
    }
  }
  return out;
}

std::int64_t wall_clock_error_ns() noexcept {
  timex state{}; // no mode bit: only read
  const int result = adjtimex(&state);
  if (result < 0 || result == TIME_ERROR || (state.status & STA_UNSYNC) != 0) {
    return 0;
  }
  return std::max<std::int64_t>(state.maxerror, 1) * 1'000;
}

} // namespace bregma::wire
