// The driver's loop: connect, read until a failure, disconnect, wait, and repeat until the driver must stop.
//
// Threads: one thread calls run(); others may read the Status meanwhile. The time comes from the Host, so that tests
// simulate hours of failures quickly.
#pragma once

#include <functional>
#include <string>

#include "base/log_level.hpp"
#include "drivers/frame/backoff.hpp"
#include "drivers/frame/device.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/frame/status.hpp"

namespace bregma::driver {

using base::LogLevel;
using Log = std::function<void(LogLevel, const std::string &)>;

enum class Ending {
  kDone,  // the device has finished, or the driver had to stop
  kFailed // permanently: the error has been logged
};

struct LoopOptions {
  BackoffOptions backoff = {};
  std::uint64_t backoff_seed = 1;
  std::int64_t silence_ns = 0; // a connection without a sample for this time counts as lost; 0: never
};

class DriverLoop {
public:
  DriverLoop(Device &device, Io &io, Status &status, Log log, const LoopOptions &options);

  [[nodiscard]] Ending run();

private:
  [[nodiscard]] Outcome<void> connect();
  [[nodiscard]] Outcome<Progress> read_once();
  [[nodiscard]] Outcome<Progress> read_until_it_ends();
  void disconnect();
  void enter(State state);
  void report_failure(const DeviceError &error, std::int64_t delay_ns);

  Device *device_;
  Io *io_;
  Status *status_;
  Log log_;
  LoopOptions options_;
  Backoff backoff_;
  std::int64_t connected_ns_ = 0;
};

} // namespace bregma::driver
