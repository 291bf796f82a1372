#include "drivers/frame/byte_stream.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <variant>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/serial_port.hpp>
#include <boost/asio/write.hpp>

#include "base/text.hpp"
#include "drivers/frame/io.hpp"

namespace bregma::driver {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;
using Clock = std::chrono::steady_clock;

constexpr std::string_view kTcp = "tcp://";
constexpr std::string_view kSerial = "serial://";
constexpr std::string_view kBaud = "?baud=";
constexpr unsigned kDefaultBaud = 115'200;
constexpr auto kSlice = std::chrono::milliseconds(20); // a request to stop is detected within this time

struct TcpAddress {
  std::string host, port;
};
struct SerialAddress {
  std::string path;
  unsigned baud = kDefaultBaud;
};
using Address = std::variant<TcpAddress, SerialAddress>;

std::optional<Address> parse(std::string_view text) {
  if (text.starts_with(kTcp)) {
    text.remove_prefix(kTcp.size());
    const std::size_t colon = text.rfind(':');
    if (colon == std::string_view::npos || colon == 0 || !base::parsed_number<std::uint16_t>(text.substr(colon + 1))) {
      return std::nullopt;
    }
    return TcpAddress{std::string(text.substr(0, colon)), std::string(text.substr(colon + 1))};
  }
  if (!text.starts_with(kSerial)) {
    return std::nullopt;
  }
  text.remove_prefix(kSerial.size());
  SerialAddress out;
  if (const std::size_t at = text.find(kBaud); at != std::string_view::npos) {
    const auto baud = base::parsed_number<unsigned>(text.substr(at + kBaud.size()));
    if (!baud || *baud == 0) {
      return std::nullopt;
    }
    out.baud = *baud;
    text = text.substr(0, at);
  }
  out.path = text;
  return out.path.starts_with("/") ? std::optional<Address>(out) : std::nullopt;
}

} // namespace

base::Result<void> check_address(const std::string &key, const std::string &address) {
  if (!parse(address)) {
    return base::failure(key + " = " + address + ": must be tcp://HOST:PORT or serial:///DEVICE?baud=N");
  }
  return {};
}

struct ByteStream::State {
  asio::io_context context;
  std::variant<std::monostate, asio::ip::tcp::socket, asio::serial_port> stream;
  std::string address;
  std::array<char, 65'536> buffer{};

  [[nodiscard]] tl::unexpected<DeviceError> failed(const std::string &why) const {
    return retry_later(address + ": " + why);
  }

  // Starts an operation and waits for its end. The operation is cancelled after the timeout or when the driver stops;
  // its partial result counts.
  template <class Start> error_code wait_for(const Io &io, Duration timeout, Start &&start) {
    error_code result;
    bool ended = false;
    start([&](const error_code &error, const auto &...) {
      result = error;
      ended = true;
    });
    const auto end = Clock::now() + timeout;
    context.restart();
    while (!ended && !io.stopping() && Clock::now() < end) {
      context.run_one_for(std::min<Clock::duration>(end - Clock::now(), kSlice));
    }
    if (!ended) {
      cancel();
      while (!ended && context.run_one() > 0) {
      }
    }
    return result;
  }

  void cancel() noexcept {
    error_code ignored;
    std::visit(
        [&](auto &open) {
          if constexpr (requires { open.cancel(ignored); }) {
            open.cancel(ignored);
          }
        },
        stream);
  }

  Outcome<void> open(const TcpAddress &tcp, const Io &io, Duration timeout) {
    error_code error;
    const auto endpoints = asio::ip::tcp::resolver(context).resolve(tcp.host, tcp.port, error);
    if (error) {
      return failed(error.message());
    }
    auto &socket = stream.emplace<asio::ip::tcp::socket>(context);
    error = wait_for(io, timeout, [&](auto handler) { asio::async_connect(socket, endpoints, handler); });
    if (error) {
      return failed(error == asio::error::operation_aborted ? "no answer" : error.message());
    }
    socket.set_option(asio::ip::tcp::no_delay(true), error);
    return {};
  }

  Outcome<void> open(const SerialAddress &serial, const Io & /*io*/, Duration /*timeout*/) {
    using Port = asio::serial_port;
    auto &port = stream.emplace<Port>(context);
    error_code error;
    port.open(serial.path, error);
    const auto set = [&](const auto &option) {
      if (!error) {
        port.set_option(option, error);
      }
    };
    set(Port::baud_rate(serial.baud));
    set(Port::character_size(8));
    set(Port::parity(Port::parity::none));
    set(Port::stop_bits(Port::stop_bits::one));
    set(Port::flow_control(Port::flow_control::none));
    return error ? Outcome<void>(failed(error.message())) : Outcome<void>();
  }

  // Calls the function with the open socket or port.
  template <class Call> auto with_stream(Call &&call) -> decltype(call(std::get<1>(stream))) {
    if (auto *socket = std::get_if<asio::ip::tcp::socket>(&stream)) {
      return call(*socket);
    }
    if (auto *port = std::get_if<asio::serial_port>(&stream)) {
      return call(*port);
    }
    return failed("is not open");
  }
};

ByteStream::ByteStream() : state_(std::make_unique<State>()) {}
ByteStream::~ByteStream() = default;

Outcome<void> ByteStream::open(const std::string &address, const Io &io, Duration timeout) {
  close();
  state_->address = address;
  const auto parsed = parse(address);
  if (!parsed) {
    return give_up(check_address("address", address).error().message);
  }
  return std::visit([&](const auto &one) { return state_->open(one, io, timeout); }, *parsed);
}

Outcome<std::string_view> ByteStream::read(const Io &io, Duration timeout) {
  return state_->with_stream([&](auto &stream) -> Outcome<std::string_view> {
    std::size_t size = 0;
    const error_code error = state_->wait_for(io, timeout, [&](auto handler) {
      stream.async_read_some(asio::buffer(state_->buffer), [&size, handler](const error_code &code, std::size_t read) {
        size = read;
        handler(code);
      });
    });
    if (error && error != asio::error::operation_aborted) {
      return state_->failed(error == asio::error::eof ? "closed by the device" : error.message());
    }
    return std::string_view(state_->buffer.data(), size);
  });
}

Outcome<void> ByteStream::write(std::string_view bytes, const Io &io, Duration timeout) {
  return state_->with_stream([&](auto &stream) -> Outcome<void> {
    const error_code error =
        state_->wait_for(io, timeout, [&](auto handler) { asio::async_write(stream, asio::buffer(bytes), handler); });
    if (error) {
      return state_->failed(error == asio::error::operation_aborted ? "takes no bytes" : error.message());
    }
    return {};
  });
}

void ByteStream::close() noexcept { state_->stream = std::monostate(); }

} // namespace bregma::driver
