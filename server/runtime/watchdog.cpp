#include "server/runtime/watchdog.hpp"

#include <utility>

#include <systemd/sd-daemon.h>

namespace bregma::runtime {
namespace {

// Errors are ignored: the service manager may have ended.
void notify(const std::string &state) { static_cast<void>(sd_notify(0, state.c_str())); }

} // namespace

Watchdog::Watchdog() {
  std::uint64_t microseconds = 0;
  if (sd_watchdog_enabled(0, &microseconds) > 0) {
    interval_ = std::chrono::microseconds(microseconds / 3);
  }
}

void Watchdog::watch(std::string name, std::function<std::uint64_t()> heartbeat) {
  const std::uint64_t now = heartbeat();
  watched_.push_back({std::move(name), std::move(heartbeat), now});
}

void Watchdog::ready(std::string_view status) { notify("READY=1\nSTATUS=" + std::string(status)); }
void Watchdog::status(std::string_view status) { notify("STATUS=" + std::string(status)); }
void Watchdog::stopping() { notify("STOPPING=1"); }

std::vector<std::string> Watchdog::feed() {
  std::vector<std::string> stuck;
  for (auto &watched : watched_) {
    const std::uint64_t now = watched.heartbeat();
    if (now == watched.last) {
      stuck.push_back(watched.name);
    }
    watched.last = now;
  }
  if (stuck.empty()) {
    notify("WATCHDOG=1");
  }
  return stuck;
}

} // namespace bregma::runtime
