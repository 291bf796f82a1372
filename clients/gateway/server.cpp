#include "clients/gateway/server.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <utility>
#include <vector>

#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/socket_base.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/beast/ssl.hpp>

#include "clients/gateway/session.hpp"

namespace bregma::gateway {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using TlsStream = beast::ssl_stream<beast::tcp_stream>;

// Bounds what the kernel keeps for a client that does not read.
constexpr int kSendBufferBytes = 512 << 10;
constexpr std::chrono::milliseconds kAcceptPause{100}; // after a failure, such as no file descriptors

class AsioServer final : public Server {
public:
  AsioServer(asio::io_context &io, std::shared_ptr<Shared> shared, std::optional<asio::ssl::context> tls)
      : io_(io), acceptor_(io), pause_(io), shared_(std::move(shared)), tls_(std::move(tls)) {}

  base::Result<void> listen(const Listen &listen) {
    beast::error_code failed;
    const auto address = asio::ip::make_address(listen.address, failed);
    const auto fail = [&](const char *what) {
      return base::failure(std::string(what) + " " + listen.address + " port " + std::to_string(listen.port) + ": " +
                           failed.message());
    };
    if (failed) {
      return fail("cannot use the address");
    }
    const tcp::endpoint endpoint(address, listen.port);
    acceptor_.open(endpoint.protocol(), failed);
    if (!failed) {
      acceptor_.set_option(asio::socket_base::reuse_address(true), failed);
    }
    if (!failed) {
      acceptor_.bind(endpoint, failed);
    }
    if (!failed) {
      acceptor_.listen(asio::socket_base::max_listen_connections, failed);
    }
    if (failed) {
      return fail("cannot listen on");
    }
    port_ = acceptor_.local_endpoint().port();
    accept();
    return {};
  }

  [[nodiscard]] std::uint16_t port() const override { return port_; }

  void news() override {
    if (!pending_.exchange(true)) {
      asio::post(io_, [this] {
        pending_ = false;
        // A socket that fails leaves the set.
        const std::vector<Watcher *> watchers(shared_->watchers.begin(), shared_->watchers.end());
        for (Watcher *watcher : watchers) {
          watcher->pump();
        }
      });
    }
  }

  void tidy() override {
    std::uint64_t seen = shared_->store.newest();
    for (const Watcher *watcher : shared_->watchers) {
      seen = std::min(seen, watcher->seen());
    }
    shared_->store.forget_ended(seen);
  }

private:
  void accept() {
    acceptor_.async_accept([this](beast::error_code failed, tcp::socket socket) {
      if (failed == asio::error::operation_aborted) {
        return;
      }
      if (failed) {
        pause_.expires_after(kAcceptPause);
        pause_.async_wait([this](beast::error_code aborted) {
          if (!aborted) {
            accept();
          }
        });
        return;
      }
      serve(std::move(socket));
      accept();
    });
  }

  void serve(tcp::socket socket) {
    shared_->metrics.connections.Increment();
    if (shared_->metrics.open_connections.Value() + shared_->metrics.watchers.Value() >= kMaxConnections) {
      shared_->metrics.refused_connections.Increment();
      return;
    }
    beast::error_code ignored;
    socket.set_option(tcp::no_delay(true), ignored);
    socket.set_option(asio::socket_base::send_buffer_size(kSendBufferBytes), ignored);
    if (!tls_) {
      std::make_shared<HttpSession<beast::tcp_stream>>(beast::tcp_stream(std::move(socket)), shared_)->run();
      return;
    }
    std::make_shared<HttpSession<TlsStream>>(TlsStream(std::move(socket), *tls_), shared_)
        ->run_after([](TlsStream &stream, auto done) {
          stream.async_handshake(asio::ssl::stream_base::server, std::move(done));
        });
  }

  asio::io_context &io_;
  tcp::acceptor acceptor_;
  asio::steady_timer pause_;
  std::shared_ptr<Shared> shared_;
  std::optional<asio::ssl::context> tls_;
  std::uint16_t port_ = 0;
  std::atomic<bool> pending_{false};
};

base::Result<asio::ssl::context> make_tls(const Listen &listen) {
  asio::ssl::context out(asio::ssl::context::tls_server);
  beast::error_code failed;
  out.set_options(asio::ssl::context::default_workarounds | asio::ssl::context::no_sslv2 |
                      asio::ssl::context::no_sslv3 | asio::ssl::context::no_tlsv1 | asio::ssl::context::no_tlsv1_1,
                  failed);
  if (!failed) {
    out.use_certificate_chain_file(listen.certificate.string(), failed);
  }
  if (failed) {
    return base::failure(listen.certificate.string() + ": this certificate cannot be used: " + failed.message());
  }
  out.use_private_key_file(listen.key.string(), asio::ssl::context::pem, failed);
  if (failed) {
    return base::failure(listen.key.string() + ": this key cannot be used: " + failed.message());
  }
  return out;
}

} // namespace

bool is_loopback(const std::string &address) {
  beast::error_code failed;
  const auto parsed = asio::ip::make_address(address, failed);
  return !failed && parsed.is_loopback();
}

base::Result<std::unique_ptr<Server>> Server::open(asio::io_context &io, std::shared_ptr<Shared> shared,
                                                   const Listen &listen) {
  std::optional<asio::ssl::context> tls;
  if (!listen.certificate.empty()) {
    auto made = make_tls(listen);
    if (!made) {
      return tl::unexpected(made.error());
    }
    tls = std::move(*made);
  }
  auto server = std::make_unique<AsioServer>(io, std::move(shared), std::move(tls));
  if (auto listening = server->listen(listen); !listening) {
    return tl::unexpected(listening.error());
  }
  return server;
}

} // namespace bregma::gateway
