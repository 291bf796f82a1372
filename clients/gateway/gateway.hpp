// The gateway: a thread that reads DDS, and the sockets on the caller's thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>

#include "base/result.hpp"
#include "clients/casefiles/case_fetcher.hpp"
#include "clients/gateway/server.hpp"

namespace bregma::live {
class DaemonLink;
}

namespace bregma::gateway {

struct Config {
  std::uint32_t domain = 0;
  Listen listen = {};
  std::vector<std::string> hosts = {}; // names under which it is asked, in addition to those of loopback
  std::string token = {};              // needed outside loopback
  std::filesystem::path page = {};     // folder with the page's files
  std::filesystem::path cache = {};    // folder for the files of cases; empty: no case is fetched
};

// The first contradiction: outside loopback TLS, a token and a host name are needed.
[[nodiscard]] base::Result<void> check(const Config &config);

class Gateway {
public:
  // Joins the domain and listens. Throws dds::Error.
  [[nodiscard]] static base::Result<std::unique_ptr<Gateway>> open(boost::asio::io_context &io, const Config &config);
  ~Gateway();
  Gateway(const Gateway &) = delete;
  Gateway &operator=(const Gateway &) = delete;

  [[nodiscard]] std::uint16_t port() const { return server_->port(); }
  [[nodiscard]] Shared &shared() { return *shared_; }

private:
  explicit Gateway(boost::asio::io_context &io);
  void read_dds();
  void await_siblings();
  void serve_case();
  void serve_patient();
  void follow_case_folder();
  bool encode_case();
  void tick();

  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
  std::unique_ptr<Server> server_;
  std::unique_ptr<live::DaemonLink> link_; // used by thread_ only
  std::unique_ptr<casefiles::CaseFetcher> cases_;
  boost::asio::steady_timer timer_;
  std::mutex mutex_;        // of the next
  std::string case_folder_; // of a daemon on this host; empty: none
  std::atomic<bool> field_wanted_{false};
  std::atomic<bool> slices_wanted_{false};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

} // namespace bregma::gateway
