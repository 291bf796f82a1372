#include "server/runtime/clock.hpp"

#include <ctime>

#include "idl/boot_clock.hpp"

namespace bregma::runtime {
namespace {

std::int64_t read(clockid_t clock) noexcept {
  timespec time{};
  clock_gettime(clock, &time);
  return static_cast<std::int64_t>(time.tv_sec) * 1'000'000'000 + time.tv_nsec;
}

} // namespace

std::int64_t SystemClock::now_ns() const noexcept { return read(CLOCK_REALTIME); }
std::int64_t SystemClock::monotonic_ns() const noexcept { return read(CLOCK_MONOTONIC); }
std::int64_t SystemClock::boot_ns() const noexcept { return wire::boot_now_ns(); }

} // namespace bregma::runtime
