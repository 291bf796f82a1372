#include "drivers/sim/terminal/pseudo_terminal.hpp"

#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <utility>

namespace bregma::sim {

base::Result<PseudoTerminal> PseudoTerminal::open() { return open(""); }

base::Result<PseudoTerminal> PseudoTerminal::open(const std::string &link) {
  PseudoTerminal out;
  std::array<char, 128> path{};
  out.device_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (out.device_ < 0 || grantpt(out.device_) != 0 || unlockpt(out.device_) != 0 ||
      ptsname_r(out.device_, path.data(), path.size()) != 0) {
    return base::failure(std::string("pseudo-terminal: ") + std::strerror(errno));
  }
  out.line_ = ::open(path.data(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  termios settings{};
  if (out.line_ < 0 || tcgetattr(out.line_, &settings) != 0) {
    return base::failure(std::string(path.data()) + ": " + std::strerror(errno));
  }
  cfmakeraw(&settings);
  (void)tcsetattr(out.line_, TCSANOW, &settings);
  if (!link.empty()) {
    (void)unlink(link.c_str());
    if (symlink(path.data(), link.c_str()) != 0) {
      return base::failure(link + ": " + std::strerror(errno));
    }
    out.link_ = link;
  }
  out.address_ = "serial://" + (link.empty() ? std::string(path.data()) : link);
  return out;
}

PseudoTerminal::PseudoTerminal(PseudoTerminal &&other) noexcept
    : address_(std::move(other.address_)), link_(std::exchange(other.link_, {})),
      device_(std::exchange(other.device_, -1)), line_(std::exchange(other.line_, -1)) {}

PseudoTerminal &PseudoTerminal::operator=(PseudoTerminal &&other) noexcept {
  std::swap(address_, other.address_);
  std::swap(link_, other.link_);
  std::swap(device_, other.device_);
  std::swap(line_, other.line_);
  return *this;
}

PseudoTerminal::~PseudoTerminal() {
  if (!link_.empty()) {
    (void)unlink(link_.c_str());
  }
  for (const int descriptor : {line_, device_}) {
    if (descriptor >= 0) {
      (void)close(descriptor);
    }
  }
}

std::string PseudoTerminal::read(std::chrono::milliseconds timeout) {
  pollfd wait{device_, POLLIN, 0};
  std::array<char, 4096> bytes{};
  if (poll(&wait, 1, static_cast<int>(timeout.count())) <= 0 || (wait.revents & POLLIN) == 0) {
    return {};
  }
  const ssize_t n = ::read(device_, bytes.data(), bytes.size());
  return n > 0 ? std::string(bytes.data(), static_cast<std::size_t>(n)) : std::string();
}

void PseudoTerminal::write(std::string_view bytes) noexcept {
  while (!bytes.empty()) {
    const ssize_t n = ::write(device_, bytes.data(), bytes.size());
    if (n <= 0) {
      return;
    }
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
}

} // namespace bregma::sim
