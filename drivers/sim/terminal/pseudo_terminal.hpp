// A serial line without hardware: the device's end of a new pseudo-terminal. The driver opens the other end by its
// address.
//
// Not for several threads at a time.
#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include "base/result.hpp"

namespace bregma::sim {

class PseudoTerminal {
public:
  [[nodiscard]] static base::Result<PseudoTerminal> open();
  // link: a path at which the line appears as long as this object lives, as udev names a device; it is replaced.
  [[nodiscard]] static base::Result<PseudoTerminal> open(const std::string &link);
  PseudoTerminal(PseudoTerminal &&other) noexcept;
  PseudoTerminal &operator=(PseudoTerminal &&other) noexcept;
  ~PseudoTerminal(); // unplugs: whoever has the other end open gets an error

  // For the driver's parameter `address`: serial:///dev/pts/N, or the link.
  [[nodiscard]] const std::string &address() const { return address_; }
  // The received bytes, as soon as there are any; empty after the timeout.
  [[nodiscard]] std::string read(std::chrono::milliseconds timeout);
  // As much as the line takes now; the rest is lost, as on a line that nobody reads.
  void write(std::string_view bytes) noexcept;

private:
  PseudoTerminal() = default;

  std::string address_;
  std::string link_;
  int device_ = -1;
  int line_ = -1; // the other end is kept open, so that the terminal does not hang up between two drivers
};

} // namespace bregma::sim
