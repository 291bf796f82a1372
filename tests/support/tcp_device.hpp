// A device at the other end of a TCP connection: listens on a free port of the loopback interface and sends the bytes
// given by the test.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace bregma::test {

class TcpDevice {
public:
  TcpDevice() : listener_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (bind(listener_, reinterpret_cast<const sockaddr *>(&address), size) != 0 || listen(listener_, 1) != 0 ||
        getsockname(listener_, reinterpret_cast<sockaddr *>(&address), &size) != 0) {
      throw std::runtime_error("cannot listen on the loopback interface");
    }
    port_ = ntohs(address.sin_port);
  }
  ~TcpDevice() {
    hang_up();
    close(listener_);
  }
  TcpDevice(const TcpDevice &) = delete;
  TcpDevice &operator=(const TcpDevice &) = delete;

  [[nodiscard]] std::string address() const { return "tcp://127.0.0.1:" + std::to_string(port_); }

  // True if a driver connects within the time. An earlier connection is closed.
  bool accept(std::chrono::milliseconds timeout = std::chrono::seconds(10)) {
    hang_up();
    pollfd waiting{listener_, POLLIN, 0};
    if (poll(&waiting, 1, static_cast<int>(timeout.count())) == 1) {
      connection_ = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      const int on = 1; // as the devices do: small messages do not wait for the last one's acknowledgement
      (void)setsockopt(connection_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    }
    return connection_ >= 0;
  }
  // False if the driver has disconnected.
  bool send(std::string_view bytes) const {
    return ::send(connection_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }
  [[nodiscard]] std::string receive(std::size_t size) const {
    std::string out(size, '\0');
    out.resize(static_cast<std::size_t>(std::max<ssize_t>(recv(connection_, out.data(), size, MSG_WAITALL), 0)));
    return out;
  }
  // What has arrived, as soon as there is something; empty after the timeout.
  [[nodiscard]] std::string receive_some(std::chrono::milliseconds timeout) const {
    pollfd waiting{connection_, POLLIN, 0};
    std::string out(4096, '\0');
    const bool ready = poll(&waiting, 1, static_cast<int>(timeout.count())) == 1;
    out.resize(
        static_cast<std::size_t>(std::max<ssize_t>(ready ? recv(connection_, out.data(), out.size(), 0) : 0, 0)));
    return out;
  }
  void hang_up() {
    if (connection_ >= 0) {
      close(connection_);
    }
    connection_ = -1;
  }

private:
  int listener_;
  int connection_ = -1;
  std::uint16_t port_ = 0;
};

} // namespace bregma::test
