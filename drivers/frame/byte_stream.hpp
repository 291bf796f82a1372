// A stream of bytes to a device, over TCP or a serial line. Waiting ends when the driver must stop.
//
// Addresses: tcp://HOST:PORT, or serial:///dev/ttyUSB0?baud=115200 (8 data bits, no parity, 1 stop bit; 115200 unless
// given). A host name is resolved by the system's resolver, which may block.
//
// Threads: one. Errors are DeviceErrors that begin with the address; open() may be called again after any of them.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <string_view>

#include "base/result.hpp"
#include "drivers/frame/device.hpp"

namespace bregma::driver {

// For Device::prepare: "key = address: must be ...".
[[nodiscard]] base::Result<void> check_address(const std::string &key, const std::string &address);

class ByteStream {
public:
  using Duration = std::chrono::nanoseconds;

  ByteStream();
  ~ByteStream();

  [[nodiscard]] Outcome<void> open(const std::string &address, const Io &io,
                                   Duration timeout = std::chrono::seconds(3));
  // The received bytes, as soon as there are any; empty after the timeout or if the driver must stop. Valid until the
  // next call.
  [[nodiscard]] Outcome<std::string_view> read(const Io &io, Duration timeout = std::chrono::milliseconds(200));
  // Writes all bytes, or returns an error.
  [[nodiscard]] Outcome<void> write(std::string_view bytes, const Io &io, Duration timeout = std::chrono::seconds(1));
  void close() noexcept;

private:
  struct State;
  std::unique_ptr<State> state_;
};

} // namespace bregma::driver
