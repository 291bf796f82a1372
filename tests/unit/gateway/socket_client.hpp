// A client of the gateway, for tests and benchmarks: blocking, plain TCP on loopback.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include "clients/gateway/records.hpp"

namespace bregma::test {

using HttpFields = std::vector<std::pair<std::string, std::string>>;

inline boost::asio::ip::tcp::socket connect_to(boost::asio::io_context &io, std::uint16_t port) {
  boost::asio::ip::tcp::socket out(io);
  out.connect({boost::asio::ip::make_address("127.0.0.1"), port});
  return out;
}

inline boost::beast::http::response<boost::beast::http::string_body> get(std::uint16_t port, const std::string &target,
                                                                         const HttpFields &fields = {}) {
  namespace http = boost::beast::http;
  boost::asio::io_context io;
  auto socket = connect_to(io, port);
  http::request<http::empty_body> request(http::verb::get, target, 11);
  request.set(http::field::host, "localhost:" + std::to_string(port));
  for (const auto &[name, value] : fields) {
    request.set(name, value);
  }
  http::write(socket, request);
  boost::beast::flat_buffer buffer;
  http::response<http::string_body> response;
  http::read(socket, buffer, response);
  return response;
}

class StateClient {
public:
  // Throws boost::system::system_error if the gateway refuses.
  explicit StateClient(std::uint16_t port, const std::string &target = "/state", const HttpFields &fields = {})
      : socket_(connect_to(io_, port)) {
    socket_.set_option(boost::beast::websocket::stream_base::decorator([fields](auto &request) {
      for (const auto &[name, value] : fields) {
        request.set(name, value);
      }
    }));
    socket_.handshake("localhost:" + std::to_string(port), target);
    socket_.binary(target.find("json") == std::string::npos);
  }

  // The next frame, which is not acknowledged.
  std::string read() {
    boost::beast::flat_buffer buffer;
    socket_.read(buffer);
    return boost::beast::buffers_to_string(buffer.data());
  }
  // The next binary frame, acknowledged.
  std::string next() {
    std::string frame = read();
    gateway::FrameHeader header;
    std::memcpy(&header, frame.data(), sizeof header);
    send(gateway::Request{static_cast<std::uint32_t>(gateway::RequestKind::kAcknowledge), header.frame, 0.0});
    return frame;
  }
  void send(const gateway::Request &request) { socket_.write(boost::asio::buffer(&request, sizeof request)); }
  void send(const std::string &text) { socket_.write(boost::asio::buffer(text)); }
  [[nodiscard]] int descriptor() { return socket_.next_layer().native_handle(); }

private:
  boost::asio::io_context io_;
  boost::beast::websocket::stream<boost::asio::ip::tcp::socket> socket_;
};

} // namespace bregma::test
