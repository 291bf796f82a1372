// The gateway's share of the age on the glass, and what clients that do not read cost the others.
//
// A publisher of two tools at 50 Hz, the gateway, and clients that acknowledge every frame at once are threads of this
// process; samples cross DDS and a socket on loopback. Blocks without and with the bad clients alternate.
//
// --memory: instead, what a gateway process keeps, over minutes with all these clients, and after a thousand
// connections.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>
#include <sys/socket.h>
#include <unistd.h>

#include "bench/record.hpp"
#include "clients/gateway/gateway.hpp"
#include "idl/boot_clock.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/gateway/socket_client.hpp"
#include "tests/unit/live/fake_daemon.hpp"

namespace {

using namespace bregma;
using namespace std::chrono_literals;
using bench::Record;

constexpr int kPeriod_ms = 20; // of the tools: below the rate of the clients, which then wait for nothing
constexpr int kClients = 18;   // and the two bad ones
constexpr double kMaxShare_ms = 2.0;
constexpr double kMaxRatio = 1.2;
constexpr double kMaxGrowth_MiB = 1.0;

double resident_MiB(const std::string &process = "self") {
  std::ifstream file("/proc/" + process + "/statm");
  double size = 0.0;
  double resident = 0.0;
  file >> size >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576.0;
}

class RunningGateway {
public:
  explicit RunningGateway(std::uint32_t domain)
      : gateway_(*gateway::Gateway::open(io_, {.domain = domain, .listen = {.port = 0}})),
        thread_([this] { io_.run(); }) {}
  ~RunningGateway() {
    io_.stop();
    thread_.join();
  }
  RunningGateway(const RunningGateway &) = delete;
  RunningGateway &operator=(const RunningGateway &) = delete;
  [[nodiscard]] std::uint16_t port() const { return gateway_->port(); }
  [[nodiscard]] gateway::Metrics &metrics() { return gateway_->shared().metrics; }

private:
  boost::asio::io_context io_{1};
  std::unique_ptr<gateway::Gateway> gateway_;
  std::thread thread_;
};

// Acknowledges every frame and keeps how old each new state of a tool was on arrival.
class Client {
public:
  explicit Client(std::uint16_t port) : client_(port), thread_([this] { run(); }) {}
  ~Client() {
    stopping_ = true;
    ::shutdown(client_.descriptor(), SHUT_RDWR);
    thread_.join();
  }
  Client(const Client &) = delete;
  Client &operator=(const Client &) = delete;
  std::vector<double> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(delays_ms_, {});
  }

private:
  void run() {
    try {
      while (!stopping_) {
        note(client_.next());
      }
    } catch (const std::exception &) { // the connection is closed
    }
  }

  void note(const std::string &frame) {
    const double now_ms = static_cast<double>(wire::boot_now_ns()) * 1e-6;
    gateway::RecordHeader header;
    for (std::size_t at = sizeof(gateway::FrameHeader); at < frame.size(); at += header.bytes) {
      std::memcpy(&header, frame.data() + at, sizeof header);
      if (header.kind != static_cast<std::uint16_t>(gateway::RecordKind::kTool)) {
        continue;
      }
      gateway::Tool tool;
      std::memcpy(&tool, frame.data() + at + sizeof header, sizeof tool);
      if (tool.status == bregma_wire_POSE_LIVE) {
        const std::lock_guard lock(mutex_);
        delays_ms_.push_back(now_ms - tool.published_ms);
      }
    }
  }

  test::StateClient client_;
  std::atomic<bool> stopping_{false};
  std::mutex mutex_;
  std::vector<double> delays_ms_;
  std::thread thread_;
};

// One that never reads, and one that reads a byte per second.
class BadClients {
public:
  explicit BadClients(std::uint16_t port) : stopped_(port), slow_(port), thread_([this] { run(); }) {}
  ~BadClients() {
    stopping_ = true;
    thread_.join();
  }
  BadClients(const BadClients &) = delete;
  BadClients &operator=(const BadClients &) = delete;

private:
  void run() {
    for (int i = 0; !stopping_; ++i) {
      char byte = 0;
      if (i % 20 == 0) {
        (void)recv(slow_.descriptor(), &byte, 1, MSG_DONTWAIT);
      }
      std::this_thread::sleep_for(50ms);
    }
  }

  test::StateClient stopped_;
  test::StateClient slow_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

// Quantile of a histogram, linear within its bucket.
double quantile(const prometheus::Histogram &histogram, double p) {
  const auto collected = histogram.Collect().histogram;
  const double wanted = p * static_cast<double>(collected.sample_count);
  double below = 0.0;
  double lower = 0.0;
  for (const auto &bucket : collected.bucket) {
    const auto count = static_cast<double>(bucket.cumulative_count);
    if (count >= wanted && count > below) {
      return std::isfinite(bucket.upper_bound)
                 ? lower + (bucket.upper_bound - lower) * (wanted - below) / (count - below)
                 : lower;
    }
    below = count;
    lower = bucket.upper_bound;
  }
  return lower;
}

void measure(bench::Report &report, bool quick) {
  test::FakeDaemon daemon;
  daemon.period_ms = kPeriod_ms;
  RunningGateway gateway(test::own_domain());
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < kClients; ++i) {
    clients.push_back(std::make_unique<Client>(gateway.port()));
  }
  std::this_thread::sleep_for(2s); // until discovery has ended
  for (const auto &client : clients) {
    (void)client->take();
  }
  std::array<std::vector<double>, 2> delays_ms; // without and with bad clients
  const int blocks = quick ? 4 : 20;
  const auto block = quick ? 4s : 10s;
  const double before_MiB = resident_MiB();
  for (int i = 0; i < blocks; ++i) {
    const bool bad = i % 2 == 1;
    const auto bad_clients = bad ? std::make_unique<BadClients>(gateway.port()) : nullptr;
    std::this_thread::sleep_for(block);
    for (const auto &client : clients) {
      const auto taken = client->take();
      auto &all = delays_ms.at(bad ? 1 : 0);
      all.insert(all.end(), taken.begin(), taken.end());
    }
  }
  const auto samples_MiB =
      static_cast<double>((delays_ms[0].capacity() + delays_ms[1].capacity()) * sizeof(double)) / 1048576.0;
  const double growth_MiB = resident_MiB() - before_MiB - samples_MiB;
  const auto &share = gateway.metrics().written_s;
  report.add(bench::figure("gateway: sample taken from DDS to socket written, p50", 1e3 * quantile(share, 0.5), "ms"));
  report.add(bench::at_most("gateway: sample taken from DDS to socket written, p99", 1e3 * quantile(share, 0.99), "ms",
                            kMaxShare_ms));
  report.add(bench::figure("published to received by a client, p50", bench::percentile(delays_ms[0], 0.5), "ms"));
  const double alone_ms = bench::percentile(delays_ms[0], 0.99);
  const double beside_ms = bench::percentile(delays_ms[1], 0.99);
  report.add(bench::figure("published to received by a client, p99, 18 clients", alone_ms, "ms"));
  report.add(bench::with_peer(
      bench::at_most("the same beside a stopped client and one of 1 byte/s", beside_ms, "ms", kMaxRatio * alone_ms),
      alone_ms, "without them"));
  report.add(bench::figure("bytes per frame", gateway.metrics().frame_bytes.Value() / gateway.metrics().frames.Value(),
                           "bytes"));
  report.add(bench::at_most("growth of the memory, gateway and clients", growth_MiB, "MiB", kMaxGrowth_MiB));
}

// What the process holds: open files, sockets among them, and threads.
std::size_t entries(const std::string &process, const char *folder) {
  const std::filesystem::directory_iterator all("/proc/" + process + "/" + folder);
  return static_cast<std::size_t>(std::distance(begin(all), end(all)));
}

// The program beside this one, on the domain of the small daemon of this process.
class GatewayProcess {
public:
  GatewayProcess()
      : process_({(std::filesystem::read_symlink("/proc/self/exe").parent_path() / "bregma-gateway").string(),
                  "--domain", std::to_string(test::own_domain()), "--port", "0", "--cache", folder_.path() / "cache"},
                 folder_ / "gateway.log") {
    for (int i = 0; i < 200 && port_ == 0; ++i) {
      std::this_thread::sleep_for(50ms);
      const std::string log = process_.log();
      const std::size_t at = log.rfind(':');
      port_ = at == std::string::npos ? 0 : static_cast<std::uint16_t>(std::strtoul(log.c_str() + at + 1, nullptr, 10));
    }
    if (port_ == 0) {
      throw std::runtime_error("bregma-gateway did not start: " + process_.log());
    }
  }
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::string pid() const { return std::to_string(process_.pid()); }

private:
  test::TemporaryFolder folder_;
  test::Process process_;
  std::uint16_t port_ = 0;
};

// Connections of every kind, most of which end badly.
void connect_often(std::uint16_t port, int count) {
  for (int i = 0; i < count; ++i) {
    boost::asio::io_context io;
    switch (i % 4) {
    case 0:
      (void)test::get(port, "/metrics");
      break;
    case 1:
      (void)test::connect_to(io, port); // and closed at once
      break;
    case 2: {
      auto socket = test::connect_to(io, port);
      boost::asio::write(socket, boost::asio::buffer("GET / HT", 8)); // half a request
      break;
    }
    default:
      (void)test::StateClient(port).next();
    }
  }
}

void measure_memory(bench::Report &report, double seconds) {
  constexpr int kConnections = 1000;
  test::FakeDaemon daemon;
  daemon.period_ms = kPeriod_ms;
  const GatewayProcess gateway;
  const std::string pid = gateway.pid();
  {
    std::vector<std::unique_ptr<Client>> clients;
    for (int i = 0; i < kClients; ++i) {
      clients.push_back(std::make_unique<Client>(gateway.port()));
    }
    const BadClients bad(gateway.port());
    // Until every buffer has had its size once. What still changes is one receive buffer of Cyclone, of 1 MiB: what
    // arrives fills it by 1 KiB per second, and then another one takes its place.
    std::this_thread::sleep_for(120s);
    std::vector<double> all;
    bench::Progress progress("memory of the gateway", static_cast<int>(seconds));
    for (int i = 0; i < static_cast<int>(seconds); ++i) {
      all.push_back(resident_MiB(pid));
      for (const auto &client : clients) {
        (void)client->take();
      }
      std::this_thread::sleep_for(1s);
      progress.step();
    }
    const auto [least, most] = std::minmax_element(all.begin(), all.end());
    report.add(bench::figure("memory of the gateway with 20 clients", all.front(), "MiB"));
    report.add(bench::at_most("change of it, largest minus smallest", *most - *least, "MiB", 2.0 * kMaxGrowth_MiB));
    report.add(bench::at_most("its end minus its begin", all.back() - all.front(), "MiB", kMaxGrowth_MiB));
  }
  connect_often(gateway.port(), kConnections); // the first ones fill the allocator's lists
  std::this_thread::sleep_for(3s);
  const double before_MiB = resident_MiB(pid);
  const auto files = entries(pid, "fd");
  const auto threads = entries(pid, "task");
  connect_often(gateway.port(), kConnections);
  std::this_thread::sleep_for(3s);
  const auto left = [&](const char *folder, std::size_t before) {
    return static_cast<double>(entries(pid, folder)) - static_cast<double>(before);
  };
  report.add(bench::at_most("1,000 connections: memory left", resident_MiB(pid) - before_MiB, "MiB", 0.1));
  report.add(bench::at_most("1,000 connections: files left open", left("fd", files), "", 0.0));
  report.add(bench::at_most("1,000 connections: threads left", left("task", threads), "", 0.0));
}

} // namespace

int main(int argc, char **argv) {
  CLI::App app("The gateway between DDS and the sockets of displays", "bench_gateway");
  bench::Options options;
  bench::add_options(app, options);
  double memory_s = 0.0;
  app.add_option("--memory", memory_s,
                 "Watch the memory of a gateway process for these seconds instead (600: ten minutes)");
  CLI11_PARSE(app, argc, argv);
  try {
    bench::Report report(options.json);
    report.note("Two tools at 50 Hz from a publisher over DDS on loopback, " + std::to_string(kClients) +
                " clients that acknowledge every frame at once, at most 60 frames per second each.");
    if (memory_s > 0.0) {
      measure_memory(report, memory_s);
    } else {
      measure(report, options.quick);
    }
    return report.all_hold() ? 0 : 1;
  } catch (const std::exception &error) {
    std::fprintf(stderr, "bench_gateway: %s\n", error.what());
    return 2;
  }
}
