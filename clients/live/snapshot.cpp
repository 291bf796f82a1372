#include "clients/live/snapshot.hpp"

#include <chrono>

#include "idl/boot_clock.hpp"

namespace bregma::live {

Now Now::read() {
  using namespace std::chrono;
  return {wire::boot_now_ns(), duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count()};
}

std::optional<std::int64_t> silence_ns(const Snapshot &snapshot, std::int64_t now_boot_ns) {
  if (!snapshot.health) {
    return std::nullopt;
  }
  const wire::Arrival &arrival = snapshot.health->arrival;
  return arrival.transit_ns.value_or(0) + now_boot_ns - arrival.boot_ns;
}

bool alive(const Snapshot &snapshot, std::int64_t now_boot_ns) {
  const auto silence = silence_ns(snapshot, now_boot_ns);
  return silence && *silence < kDaemonSilent_ns && !snapshot.no_writer;
}

std::optional<std::int64_t> daemon_now_ns(const Snapshot &snapshot, std::int64_t now_boot_ns) {
  return snapshot.daemon_clock_ns ? std::optional(*snapshot.daemon_clock_ns + now_boot_ns) : std::nullopt;
}

} // namespace bregma::live
