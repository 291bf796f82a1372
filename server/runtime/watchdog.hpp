// Readiness and watchdog messages to systemd (sd_notify). Without NOTIFY_SOCKET in the environment they have no effect.
//
// systemd's watchdog is triggered only while every watched loop advances, so systemd restarts the daemon if a loop
// hangs.
// Threads: one (the control thread).
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace bregma::runtime {

class Watchdog {
public:
  Watchdog(); // reads the environment

  // heartbeat: a count that increases while the loop runs, for example LoopStatistics::steps. Read on this thread.
  void watch(std::string name, std::function<std::uint64_t()> heartbeat);

  void ready(std::string_view status);
  void status(std::string_view status);
  void stopping();

  // Interval for calls of feed(): a third of systemd's timeout. nullopt if systemd requests no watchdog.
  [[nodiscard]] std::optional<std::chrono::microseconds> interval() const noexcept { return interval_; }

  // Triggers the watchdog if every watched loop has advanced since the last call. Returns the names of those that have
  // not.
  std::vector<std::string> feed();

private:
  struct Watched {
    std::string name;
    std::function<std::uint64_t()> heartbeat;
    std::uint64_t last;
  };
  std::vector<Watched> watched_;
  std::optional<std::chrono::microseconds> interval_;
};

} // namespace bregma::runtime
