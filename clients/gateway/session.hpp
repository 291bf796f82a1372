// A connection: HTTP, and after an upgrade the socket of /state. Stream is a TCP stream, TLS on one, or a test's.
//
// Back-pressure: at most one frame is under way to a client. The next one is made of the latest values when the client
// has acknowledged the last, at its rate, and every write must end within kDrain.
//
// Threads: that of the io_context. Lifetime: a session owns itself while an operation is pending; it ends with its
// connection.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <nlohmann/json.hpp>

#include "clients/gateway/answer.hpp"
#include "clients/gateway/layout.hpp"
#include "clients/gateway/request.hpp"
#include "clients/gateway/shared.hpp"
#include "idl/boot_clock.hpp"

namespace bregma::gateway {

namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;

inline constexpr std::chrono::seconds kDrain{2};  // a write that has made no progress for this time ends the connection
inline constexpr std::chrono::seconds kIdle{30};  // between the requests of a connection
inline constexpr std::chrono::seconds kHeader{5}; // for the first request, and for handshakes
inline constexpr std::uint32_t kMaxHeaderBytes = 8192;

template <class Stream> void close_transport(Stream &stream) { beast::get_lowest_layer(stream).close(); }

template <class Stream>
class StateSession final : public Watcher, public std::enable_shared_from_this<StateSession<Stream>> {
public:
  StateSession(Stream stream, std::shared_ptr<Shared> shared, bool json)
      : socket_(std::move(stream)), drain_(socket_.get_executor()), pace_(socket_.get_executor()),
        shared_(std::move(shared)), json_(json) {}
  ~StateSession() override { leave(); }
  StateSession(const StateSession &) = delete;
  StateSession &operator=(const StateSession &) = delete;

  // The request is the upgrade; it is used during the call only.
  void run(const http::request<http::empty_body> &request) {
    socket_.set_option(websocket::stream_base::timeout{kHeader, kIdle, true});
    socket_.set_option(websocket::stream_base::decorator([](websocket::response_type &response) {
      for (const auto &[name, value] : common_headers()) {
        response.set(name, value);
      }
    }));
    socket_.read_message_max(kMaxRequestBytes);
    socket_.auto_fragment(false);
    socket_.binary(!json_);
    socket_.async_accept(request, [self = this->shared_from_this()](beast::error_code failed) {
      if (!failed) {
        self->shared_->watchers.insert(self.get());
        self->shared_->metrics.watchers.Increment();
        self->watching_ = true;
        self->read();
        self->pump();
      }
    });
  }

  void pump() override {
    if (!watching_ || waiting_ || writing_) {
      return;
    }
    const auto now = std::chrono::steady_clock::now();
    // Half a period of slack: a source of the same rate is not delayed by its jitter.
    if (now + period_ / 2 < next_) {
      wake_at(next_ - period_ / 2);
      return;
    }
    auto frame = shared_->store.next({seen_, number_ + 1, wire::boot_now_ns(), field_, slices_, pong_});
    if (!frame) {
      return;
    }
    next_ = std::max(next_ + period_, now);
    seen_ = frame->up_to;
    pong_.reset();
    ++number_;
    write(std::move(*frame));
  }

  [[nodiscard]] std::uint64_t seen() const override { return seen_; }
  [[nodiscard]] bool wants_field() const override { return field_; }
  [[nodiscard]] bool wants_slices() const override { return slices_; }

private:
  void leave() {
    if (watching_) {
      watching_ = false;
      shared_->watchers.erase(this);
      shared_->metrics.watchers.Decrement();
    }
  }

  void wake_at(std::chrono::steady_clock::time_point time) {
    if (pacing_) {
      return;
    }
    pacing_ = true;
    pace_.expires_at(time);
    pace_.async_wait([weak = this->weak_from_this()](beast::error_code failed) {
      if (const auto self = weak.lock(); self && !failed) {
        self->pacing_ = false;
        self->pump();
      }
    });
  }

  void write(Frame frame) {
    taken_ns_ = frame.taken_ns;
    if (json_) {
      const std::string text = frame_json(frame.bytes).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
      out_.assign(reinterpret_cast<const std::byte *>(text.data()),
                  reinterpret_cast<const std::byte *>(text.data()) + text.size());
    } else {
      out_ = std::move(frame.bytes);
    }
    writing_ = waiting_ = true;
    drain_.expires_after(kDrain);
    drain_.async_wait([weak = this->weak_from_this()](beast::error_code failed) {
      if (const auto self = weak.lock(); self && !failed && self->writing_) {
        self->shared_->metrics.closed_slow.Increment();
        self->end();
      }
    });
    socket_.async_write(
        boost::asio::buffer(out_), [self = this->shared_from_this()](beast::error_code failed, std::size_t bytes) {
          self->writing_ = false;
          self->drain_.cancel();
          if (failed) {
            return self->end();
          }
          self->shared_->metrics.frames.Increment();
          self->shared_->metrics.frame_bytes.Increment(static_cast<double>(bytes));
          if (self->taken_ns_ > 0) {
            self->shared_->metrics.written_s.Observe(static_cast<double>(wire::boot_now_ns() - self->taken_ns_) * 1e-9);
          }
          self->pump(); // the acknowledgement may have been faster than this
        });
  }

  void read() {
    socket_.async_read(in_, [self = this->shared_from_this()](beast::error_code failed, std::size_t) {
      if (failed) {
        return self->end();
      }
      const auto data = self->in_.cdata();
      const auto *begin = static_cast<const std::byte *>(data.data());
      const auto request = self->json_ ? parse_json_request({reinterpret_cast<const char *>(begin), data.size()})
                                       : parse_request({begin, data.size()});
      if (!request || self->socket_.got_text() != self->json_) {
        return self->refuse();
      }
      self->in_.consume(self->in_.size());
      self->follow(*request);
      self->pump();
      self->read();
    });
  }

  void follow(const Request &request) {
    switch (static_cast<RequestKind>(request.kind)) {
    case RequestKind::kAcknowledge:
      waiting_ = waiting_ && request.value != number_;
      break;
    case RequestKind::kRate:
      period_ = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / request.value));
      next_ = std::min(next_, std::chrono::steady_clock::now() + period_);
      break;
    case RequestKind::kPing:
      pong_ = Pong{request.client_ms, static_cast<double>(wire::boot_now_ns()) * 1e-6, 0.0};
      break;
    case RequestKind::kField:
      field_ = request.value != 0;
      break;
    case RequestKind::kSlices:
      slices_ = request.value != 0;
      if (slices_) { // the last slice may stay the last one for long
        seen_ = std::min(seen_, shared_->store.before(RecordKind::kSlice));
      }
      break;
    }
  }

  void refuse() {
    shared_->metrics.closed_bad.Increment();
    leave();
    socket_.async_close(websocket::close_code::policy_error,
                        [self = this->shared_from_this()](beast::error_code) { self->end(); });
  }

  void end() {
    leave();
    pace_.cancel();
    drain_.cancel();
    close_transport(socket_);
  }

  websocket::stream<Stream> socket_;
  boost::asio::steady_timer drain_;
  boost::asio::steady_timer pace_;
  std::shared_ptr<Shared> shared_;
  bool json_;
  beast::flat_static_buffer<kMaxRequestBytes + 16> in_;
  std::vector<std::byte> out_;
  std::int64_t taken_ns_ = 0; // of the frame that is written
  bool watching_ = false;
  bool writing_ = false;
  bool waiting_ = false; // for the acknowledgement of number_
  bool pacing_ = false;
  bool field_ = false;
  bool slices_ = false;
  std::optional<Pong> pong_;
  std::uint64_t seen_ = 0;
  std::uint32_t number_ = 0;
  std::chrono::nanoseconds period_{static_cast<std::int64_t>(1e9 / kMaxRate_hz)};
  std::chrono::steady_clock::time_point next_{};
};

template <class Stream> class HttpSession final : public std::enable_shared_from_this<HttpSession<Stream>> {
public:
  HttpSession(Stream stream, std::shared_ptr<Shared> shared)
      : stream_(std::move(stream)), timer_(stream_.get_executor()), shared_(std::move(shared)) {
    shared_->metrics.open_connections.Increment();
  }
  ~HttpSession() { shared_->metrics.open_connections.Decrement(); }
  HttpSession(const HttpSession &) = delete;
  HttpSession &operator=(const HttpSession &) = delete;

  void run() { read(kHeader); }

  // Before run(): a handshake of TLS, which ends in run().
  template <class Handshake> void run_after(Handshake &&handshake) {
    arm(kHeader);
    handshake(stream_, [self = this->shared_from_this()](beast::error_code failed) {
      if (!failed) {
        self->run();
      }
    });
  }

private:
  void arm(std::chrono::nanoseconds time) {
    timer_.expires_after(time);
    timer_.async_wait([weak = this->weak_from_this()](beast::error_code failed) {
      if (const auto self = weak.lock(); self && !failed) {
        self->shared_->metrics.closed_slow.Increment(self->writing_ ? 1.0 : 0.0);
        close_transport(self->stream_);
      }
    });
  }

  void read(std::chrono::nanoseconds within) {
    arm(within);
    parser_.emplace();
    parser_->header_limit(kMaxHeaderBytes);
    parser_->body_limit(0);
    http::async_read(stream_, in_, *parser_, [self = this->shared_from_this()](beast::error_code failed, std::size_t) {
      self->timer_.cancel();
      if (!failed) {
        self->respond(self->parser_->release());
      }
    });
  }

  void respond(http::request<http::empty_body> request) {
    const auto view = [](beast::string_view text) { return std::string_view(text.data(), text.size()); };
    const Query query{view(request.method_string()),
                      view(request.target()),
                      view(request[http::field::host]),
                      view(request[http::field::origin]),
                      view(request[http::field::authorization]),
                      view(request[http::field::cookie]),
                      websocket::is_upgrade(request)};
    auto result = answer(shared_->site, query);
    if (const auto *stream = std::get_if<Stream_>(&result)) {
      shared_->metrics.count_answer(101);
      upgrade(request, stream->json);
      return;
    }
    send(request, std::get<Answer>(result));
  }

  void upgrade(const http::request<http::empty_body> &request, bool json) {
    std::make_shared<StateSession<Stream>>(std::move(stream_), shared_, json)->run(request);
  }

  template <class Body>
  void prepare(http::response<Body> &response, const http::request<http::empty_body> &request, const Answer &answer) {
    response.version(request.version());
    response.result(static_cast<unsigned>(answer.status));
    response.keep_alive(request.keep_alive());
    for (const auto &[name, value] : common_headers()) {
      response.set(name, value);
    }
    for (const auto &[name, value] : answer.headers) {
      response.set(name, value);
    }
    response.set(http::field::content_type, answer.type);
    response.set(http::field::cache_control, answer.immutable ? "private, max-age=31536000, immutable" : "no-store");
  }

  void send(const http::request<http::empty_body> &request, const Answer &answer) {
    if (const auto *path = std::get_if<std::filesystem::path>(&answer.body)) {
      http::response<http::file_body> response;
      beast::error_code failed;
      response.body().open(path->c_str(), beast::file_mode::scan, failed);
      if (failed) {
        Answer missing;
        missing.status = 404;
        missing.body = std::make_shared<const std::string>(R"({"error":"this file of the case cannot be read"})");
        return send(request, missing);
      }
      prepare(response, request, answer);
      response.prepare_payload();
      return write(std::move(response), request.method() == http::verb::head, answer.status);
    }
    http::response<http::string_body> response;
    prepare(response, request, answer);
    const auto &text = std::get<std::shared_ptr<const std::string>>(answer.body);
    response.body() = text ? *text : std::string();
    response.prepare_payload();
    write(std::move(response), request.method() == http::verb::head, answer.status);
  }

  // An answer under way, with what it needs until its end.
  template <class Body> struct Sending {
    explicit Sending(http::response<Body> &&message) : response(std::move(message)), serializer(response) {}
    http::response<Body> response;
    http::response_serializer<Body> serializer;
  };

  template <class Body> void write(http::response<Body> &&response, bool head, int status) {
    shared_->metrics.count_answer(status);
    auto sending = std::make_shared<Sending<Body>>(std::move(response));
    writing_ = true;
    if (head) {
      arm(kDrain);
      auto &serializer = sending->serializer;
      http::async_write_header(stream_, serializer,
                               [self = this->shared_from_this(), sending](beast::error_code failed, std::size_t) {
                                 self->written(failed, !sending->response.keep_alive());
                               });
      return;
    }
    write_some(std::move(sending));
  }

  // Part by part, because a large file may take long, and a reader that takes nothing may not.
  template <class Body> void write_some(std::shared_ptr<Sending<Body>> sending) {
    arm(kDrain);
    auto &serializer = sending->serializer;
    http::async_write_some(stream_, serializer,
                           [self = this->shared_from_this(), sending](beast::error_code failed, std::size_t) mutable {
                             if (failed || sending->serializer.is_done()) {
                               return self->written(failed, !sending->response.keep_alive());
                             }
                             self->write_some(std::move(sending));
                           });
  }

  void written(beast::error_code failed, bool last) {
    writing_ = false;
    timer_.cancel();
    if (failed || last) {
      return close_transport(stream_);
    }
    read(kIdle);
  }

  using Stream_ = gateway::Stream;

  Stream stream_;
  boost::asio::steady_timer timer_;
  std::shared_ptr<Shared> shared_;
  beast::flat_buffer in_{kMaxHeaderBytes};
  std::optional<http::request_parser<http::empty_body>> parser_;
  bool writing_ = false;
};

} // namespace bregma::gateway
