// Two hosts on a network (network namespaces), for the display's tests: a daemon whose states stay the same, the case
// server and a gateway on the first, and a gateway on the second, whose case comes over the network.
//
//   display_two_hosts PROGRAMS PAGE CASE FOLDER
//
// Prints "PID ADDRESS" of each gateway, and runs until its input ends. Exit code 77: hosts cannot be made here.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tests/network/ethernet.hpp"
#include "tests/support/process.hpp"
#include "tests/unit/live/fake_daemon.hpp"

namespace {

using namespace bregma::test;
using namespace std::chrono_literals;

enum Host : std::size_t { kDaemonHost, kDisplayHost, kHosts };

constexpr int kSkipped = 77;

// What the gateway prints when it serves.
std::string address_of(const Process &gateway) {
  for (int i = 0; i < 200; ++i) {
    const std::string log = gateway.log();
    if (const std::size_t at = log.find("http://");
        at != std::string::npos && log.find('\n', at) != std::string::npos) {
      return log.substr(at, log.find('\n', at) - at);
    }
    std::this_thread::sleep_for(50ms);
  }
  throw std::runtime_error("bregma-gateway did not start: " + gateway.log());
}

void run(const std::string &programs, const std::string &page, const std::string &case_folder,
         const std::filesystem::path &folder) {
  setenv("CYCLONEDDS_URI", "file://" BREGMA_SOURCE_DIR "/deploy/cyclonedds-network.xml", 1);
  Ethernet lan(kHosts, 11);
  const std::string domain = std::to_string(own_domain());
  std::unique_ptr<FakeDaemon> daemon;
  std::unique_ptr<Process> server;
  lan.run_on(kDaemonHost, [&] {
    daemon = std::make_unique<FakeDaemon>();
    daemon->period_ms = 20;
    daemon->case_folder = case_folder.c_str();
    server = std::make_unique<Process>(std::vector<std::string>{programs + "/bregma-case-server", "--domain", domain},
                                       (folder / "server.log").string());
  });
  std::vector<std::unique_ptr<Process>> gateways;
  for (const std::size_t host : {kDaemonHost, kDisplayHost}) {
    const std::string name = "host" + std::to_string(host);
    lan.run_on(host, [&] {
      gateways.push_back(
          std::make_unique<Process>(std::vector<std::string>{programs + "/bregma-gateway", "--domain", domain, "--port",
                                                             "0", "--page", page, "--cache", (folder / name).string()},
                                    (folder / (name + ".log")).string()));
    });
    std::printf("%d %s\n", static_cast<int>(gateways.back()->pid()), address_of(*gateways.back()).c_str());
    std::fflush(stdout);
  }
  while (std::getchar() != EOF) {
  }
  gateways.clear();
  server.reset();
  lan.run_on(kDaemonHost, [&] { daemon.reset(); });
}

} // namespace

int main(int argc, char **argv) {
  try {
    if (argc != 5) {
      std::fprintf(stderr, "usage: display_two_hosts PROGRAMS PAGE CASE FOLDER\n");
      return 2;
    }
    if (const std::string why = Ethernet::unavailable(); !why.empty()) {
      std::fprintf(stderr, "%s\n", why.c_str());
      return kSkipped;
    }
    run(argv[1], argv[2], argv[3], argv[4]);
    return 0;
  } catch (const std::exception &error) {
    std::fprintf(stderr, "display_two_hosts: %s\n", error.what());
    return 1;
  }
}
