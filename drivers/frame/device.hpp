// Interface for the author of a driver: a class that connects, reads and disconnects, without DDS or threads.
//
//   class RangeSensor final : public driver::Device {
//   public:
//     using Writes = driver::Topics<wire::RangeSample>;
//     using Reads = driver::Topics<>;
//     void declare(base::ParameterSet &parameters) override;  // --set, --config, --print-config
//     driver::Outcome<void> connect(driver::Io &io) override;
//     driver::Outcome<driver::Progress> read(driver::Io &io) override;
//     void disconnect() noexcept override;
//   };
//   int main(int argc, char **argv) { RangeSensor sensor; return driver::run(argc, argv, {...}, sensor); }
//
// Threads: the frame calls a device from one thread, and only that thread may use Io: a vendor's library with callbacks
// fills a queue that read() empties. An exception derived from std::exception that leaves connect()
// or read() counts as a temporary failure.
#pragma once

#include <string>
#include <utility>

#include <tl/expected.hpp>

#include "base/parameters.hpp"

namespace bregma::driver {

class Io;
struct Settings;

struct DeviceError {
  std::string message;    // for users: the device's address and the problem
  bool permanent = false; // no further attempts: the program ends with exit code 1
};

template <class T> using Outcome = tl::expected<T, DeviceError>;

[[nodiscard]] inline tl::unexpected<DeviceError> retry_later(std::string message) {
  return tl::unexpected<DeviceError>(DeviceError{std::move(message), false});
}
[[nodiscard]] inline tl::unexpected<DeviceError> give_up(std::string message) {
  return tl::unexpected<DeviceError>(DeviceError{std::move(message), true});
}

enum class Progress {
  kContinue,
  kFinished // end of a file or script: the program ends with exit code 0
};

// The wire types that a device publishes or takes. A type may be in only one of the two lists.
template <class... Types> struct Topics {};

class Device {
public:
  Device() = default;
  Device(const Device &) = delete;
  Device &operator=(const Device &) = delete;
  virtual ~Device() = default;

  // Called once, before anything else: declares the device's own parameters.
  virtual void declare(base::ParameterSet & /*parameters*/) {}
  // Called once when all parameters are known. An error counts as invalid input: the program ends with exit code 2.
  [[nodiscard]] virtual base::Result<void> prepare(const Settings & /*settings*/) { return {}; }

  // Opens the connection. Should return within a second after io.stopping() becomes true.
  [[nodiscard]] virtual Outcome<void> connect(Io &io) = 0;
  // Waits for samples, at most for a few tenths of a second, and publishes the received ones. An error ends the
  // connection.
  [[nodiscard]] virtual Outcome<Progress> read(Io &io) = 0;
  // Called after every connect(), also after a failed one.
  virtual void disconnect() noexcept = 0;
};

} // namespace bregma::driver
