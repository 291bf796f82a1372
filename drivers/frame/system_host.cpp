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

} // namespace

SystemHost::SystemHost()
    : boot_id_(wire::boot_id()), utc_minus_boot_ns_(wire::wall_minus_boot_ns()), wake_(eventfd(0, EFD_CLOEXEC)) {
  if (wake_ < 0) {
    throw std::system_error(errno, std::generic_category(), "cannot make an event");
  }
}

SystemHost::~SystemHost() { close(wake_); }

std::int64_t SystemHost::now_ns() const { return wire::boot_now_ns() + utc_minus_boot_ns_; }

wire::WriteTime SystemHost::write_time() const {
  const std::int64_t boot_ns = wire::boot_now_ns();
  return {.boot_id = boot_id_,
          .boot_ns = boot_ns,
          .wall_ns = boot_ns + wire::wall_minus_boot_ns(),
          .wall_error_ns = wire::wall_clock_error_ns()};
}

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
