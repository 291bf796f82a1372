// Runs a driver's loop on a separate thread and watches it from the caller's: signals, health topic, log of dropped
// samples. A blocking device therefore cannot delay them.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/frame/io.hpp"
#include "drivers/frame/loop.hpp"
#include "drivers/frame/system_host.hpp"

namespace bregma::driver {

// Exit codes of a driver.
inline constexpr int kExitDone = 0;     // finished, or ended by SIGINT or SIGTERM
inline constexpr int kExitFailed = 1;   // the device failed permanently
inline constexpr int kExitBadInput = 2; // command line, parameters, or a DDS domain that cannot be joined
inline constexpr int kExitBlocked = 3;  // the device did not return after a signal: ended without disconnect()

// SIGINT and SIGTERM arrive at a file descriptor. Must be made before any other thread, which inherits the mask. They
// stay blocked afterwards, so that a second one does not cut off the end of the program. Throws std::system_error.
class Signals {
public:
  Signals();
  ~Signals();
  Signals(const Signals &) = delete;
  Signals &operator=(const Signals &) = delete;
  [[nodiscard]] int descriptor() const { return descriptor_; }
  [[nodiscard]] bool taken() const; // true if one has arrived since the last call

private:
  int descriptor_;
};

struct SupervisorOptions {
  std::string device;
  std::int64_t health_period_ns = 1'000'000'000;
  std::int64_t blocked_ns = 5'000'000'000; // a device that does not return for this time is reported
  std::int64_t grace_ns = 2'000'000'000;   // time after a signal until the process ends with kExitBlocked
};

// Blocks until the loop ends. Returns kExitDone or kExitFailed. A device that blocks beyond grace_ns ends the process.
[[nodiscard]] int supervise(DriverLoop &loop, const Signals &signals, SystemHost &host, const Status &status, Bus &bus,
                            const Log &log, const SupervisorOptions &options);

} // namespace bregma::driver
