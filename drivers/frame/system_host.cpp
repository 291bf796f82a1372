#include "drivers/frame/system_host.hpp"

#include <cerrno>
#include <ctime>
#include <system_error>

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

namespace bregma::driver {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::int64_t read_clock(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * kSecond_ns + now.tv_nsec;
}

} // namespace

SystemHost::SystemHost()
    : utc_ahead_ns_(read_clock(CLOCK_REALTIME) - read_clock(CLOCK_MONOTONIC)), wake_(eventfd(0, EFD_CLOEXEC)) {
  if (wake_ < 0) {
    throw std::system_error(errno, std::generic_category(), "cannot make an event");
  }
}

SystemHost::~SystemHost() { close(wake_); }

std::int64_t SystemHost::now_ns() const { return read_clock(CLOCK_MONOTONIC) + utc_ahead_ns_; }

bool SystemHost::wait_until(std::int64_t time_ns) {
  for (;;) {
    if (stopping()) {
      return false;
    }
    const std::int64_t left_ns = time_ns - now_ns();
    if (left_ns <= 0) {
      return true;
    }
    const timespec timeout{left_ns / kSecond_ns, left_ns % kSecond_ns};
    pollfd wake{wake_, POLLIN, 0};
    (void)ppoll(&wake, 1, &timeout, nullptr);
  }
}

void SystemHost::stop() noexcept {
  stopping_.store(true, std::memory_order_release);
  (void)eventfd_write(wake_, 1);
}

} // namespace bregma::driver
