// The listener: accepts connections and runs their sessions, plain or with TLS, on one io_context.
//
// Threads: that of the io_context, except news(), which any thread may call.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include <boost/asio/io_context.hpp>

#include "base/result.hpp"
#include "clients/gateway/shared.hpp"

namespace bregma::gateway {

inline constexpr int kMaxConnections = 256;

struct Listen {
  std::string address = "127.0.0.1";
  std::uint16_t port = 8310;              // 0: a free one
  std::filesystem::path certificate = {}; // PEM chain; empty: no TLS
  std::filesystem::path key = {};         // PEM
};

// False for a text that is no address, or an address that others can reach.
[[nodiscard]] bool is_loopback(const std::string &address);

class Server {
public:
  // Listens; the error names address or file. io outlives the server.
  [[nodiscard]] static base::Result<std::unique_ptr<Server>> open(boost::asio::io_context &io,
                                                                  std::shared_ptr<Shared> shared, const Listen &listen);
  virtual ~Server() = default;

  [[nodiscard]] virtual std::uint16_t port() const = 0;
  // There is news in the store: every socket that may sends its next frame.
  virtual void news() = 0;
  // Forgets ended instances that every client knows.
  virtual void tidy() = 0;
};

} // namespace bregma::gateway
