// Readiness and watchdog towards systemd (sd_notify). Without NOTIFY_SOCKET in the environment all of it does nothing.
//
// systemd's watchdog is fed only while every watched loop advances, so that one stuck loop gets the daemon restarted.
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

  // heartbeat: a count that grows while the loop lives, for example LoopStatistics::steps. Must be readable from here.
  void watch(std::string name, std::function<std::uint64_t()> heartbeat);

  void ready(std::string_view status);
  void status(std::string_view status);
  void stopping();

  // At what interval feed() has to be called: a third of systemd's time. nullopt when no watchdog is asked for.
  [[nodiscard]] std::optional<std::chrono::microseconds> interval() const noexcept { return interval_; }

  // Feeds systemd if every watched loop has advanced since the last call. Returns the names of those that have not.
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
