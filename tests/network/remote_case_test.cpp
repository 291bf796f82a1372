// A display on a host of its own, without a shared folder: its case comes over DDS from the daemon's host, while states
// of the daemon go on. Hosts are network namespaces (ethernet.hpp) with the configuration that is shipped.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "base/read_file.hpp"
#include "clients/casefiles/case_fetcher.hpp"
#include "clients/casefiles/case_sender.hpp"
#include "idl/boot_clock.hpp"
#include "idl/names.hpp"
#include "tests/network/ethernet.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::test {
namespace {

using namespace std::chrono_literals;
using casefiles::CaseFetcher;
using casefiles::CaseSender;
using casefiles::CaseStatus;

enum Host : std::size_t { kDaemonHost, kDisplayHost, kOtherHost, kHosts };

constexpr std::uint32_t kFirstInstance = 1000;                    // each host is a domain instance of this process
constexpr std::size_t kImageBytes = std::size_t{181} * 217 * 181; // the demo's, 8 bits
constexpr std::size_t kMeshBytes = 400'000;

void configure() {
  const std::uint32_t domain = 100 + static_cast<std::uint32_t>(getpid()) % 100;
  std::string uri = "file://" BREGMA_SOURCE_DIR "/deploy/cyclonedds-network.xml";
  for (std::uint32_t instance = kFirstInstance; instance < kFirstInstance + kHosts; ++instance) {
    uri += ",<CycloneDDS><Domain Id=\"" + std::to_string(instance) + "\"><Discovery><ExternalDomainId>" +
           std::to_string(domain) + "</ExternalDomainId></Discovery></Domain></CycloneDDS>";
  }
  setenv("CYCLONEDDS_URI", uri.c_str(), 1);
}

casefiles::Bundle bundle_of(std::uint32_t seed) {
  std::mt19937 random(seed);
  casefiles::Bundle out;
  out.case_id = "colin27";
  const auto file = [&](std::size_t size) {
    std::vector<std::byte> bytes(size);
    std::generate(bytes.begin(), bytes.end(), [&] { return static_cast<std::byte>(random()); });
    const casefile::Hash hash = casefile::sha256(std::span<const std::byte>(bytes));
    out.files[hash] = std::move(bytes);
    return nlohmann::json{{"sha256", casefile::to_hex(hash)}, {"bytes", size}};
  };
  nlohmann::json meshes = nlohmann::json::array();
  for (const char *name : {"scalp", "brain", "tissue"}) {
    meshes.push_back(file(kMeshBytes));
    meshes.back()["file"] = name;
  }
  out.manifest = nlohmann::json{{"id", out.case_id}, {"image", file(kImageBytes)}, {"meshes", meshes}}.dump();
  return out;
}

// Runs on a thread of a host until it is destroyed.
class HostThread {
public:
  template <class Job> HostThread(Ethernet &lan, std::size_t host, Job job) {
    lan.run_on(host, [&] { thread_ = std::thread([this, job] { job(stopping_); }); });
  }
  ~HostThread() {
    stopping_ = true;
    thread_.join();
  }
  HostThread(const HostThread &) = delete;
  HostThread &operator=(const HostThread &) = delete;

private:
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class RemoteCase : public ::testing::Test {
protected:
  void SetUp() override {
    if (const std::string why = Ethernet::unavailable(); !why.empty()) {
      GTEST_SKIP() << "this process cannot make hosts on a network: " << why;
    }
    configure();
    lan_.emplace(kHosts, 7);
  }

  // Serves the offer, and publishes states of a tool at 60 Hz from another participant of the daemon's host.
  void start_daemon_host() {
    server_.emplace(*lan_, kDaemonHost, [this](const std::atomic<bool> &stopping) {
      const dds::Participant participant(kFirstInstance + kDaemonHost);
      CaseSender sender(participant, "daemon-host");
      while (!stopping) {
        if (const std::uint32_t seed = offer_.exchange(0); seed != 0) {
          sender.offer(bundle_of(seed));
        }
        sender.serve(5ms);
      }
    });
    states_.emplace(*lan_, kDaemonHost, [](const std::atomic<bool> &stopping) {
      const dds::Participant participant(kFirstInstance + kDaemonHost);
      const dds::Writer<wire::NavigationState> writer(participant);
      while (!stopping) {
        wire::NavigationState state{};
        (void)wire::set_name(state.tool, "Probe");
        state.published_boot_ns = wire::boot_now_ns();
        (void)writer.write(state);
        std::this_thread::sleep_for(16667us);
      }
    });
    watch_.emplace(*lan_, kOtherHost, [this](const std::atomic<bool> &stopping) {
      const dds::Participant participant(kFirstInstance + kOtherHost);
      dds::Reader<wire::NavigationState> reader(participant);
      dds::WaitSet wait(participant);
      wait.attach(reader);
      while (!stopping) {
        (void)wait.wait(20ms);
        reader.take_each([&](const wire::NavigationState &state, const dds::SampleInfo &) {
          const std::lock_guard lock(mutex_);
          delays_ms_.push_back(static_cast<double>(wire::boot_now_ns() - state.published_boot_ns) * 1e-6);
        });
        (void)reader.status();
      }
    });
  }

  double p99_ms() {
    const std::lock_guard lock(mutex_);
    std::vector<double> delays = std::exchange(delays_ms_, {});
    if (delays.empty()) {
      return 0.0;
    }
    std::sort(delays.begin(), delays.end());
    return delays[static_cast<std::size_t>(0.99 * static_cast<double>(delays.size() - 1))];
  }

  // A new display on its host, with an empty folder: seconds until it has the case, or nothing after a minute.
  std::optional<double> fetch(std::uint32_t seed) {
    const TemporaryFolder folder;
    const auto cases = *CaseFetcher::make_folder(folder / "cases");
    std::optional<double> seconds;
    offer_ = seed;
    lan_->run_on(kDisplayHost, [&] {
      const dds::Participant participant(kFirstInstance + kDisplayHost);
      CaseFetcher fetcher(participant, cases);
      wire::BootId boot_id;
      const auto own = wire::boot_id(); // one kernel
      std::copy(own.begin(), own.end(), std::begin(boot_id));
      fetcher.follow(boot_id);
      const std::string wanted = casefile::to_hex(casefile::sha256(bundle_of(seed).manifest));
      std::optional<std::chrono::steady_clock::time_point> began;
      for (const auto end = std::chrono::steady_clock::now() + 60s; std::chrono::steady_clock::now() < end;) {
        const CaseStatus status = fetcher.status();
        if (status.state == CaseStatus::State::kOnItsWay && !began) {
          began = std::chrono::steady_clock::now();
        }
        if (status.hash == wanted) {
          const auto now = std::chrono::steady_clock::now();
          seconds = std::chrono::duration<double>(now - began.value_or(now)).count();
          compare(fetcher, bundle_of(seed));
          return;
        }
        std::this_thread::sleep_for(2ms);
      }
      ADD_FAILURE() << "state " << static_cast<int>(fetcher.status().state) << ": " << fetcher.status().text;
    });
    return seconds;
  }

  // What the display serves is what the daemon's host has, byte for byte.
  static void compare(const CaseFetcher &fetcher, const casefiles::Bundle &bundle) {
    const auto json = nlohmann::json::parse(*fetcher.json());
    std::vector<std::string> names{"image"};
    for (const auto &mesh : json["meshes"]) {
      names.push_back("mesh/" + mesh["file"].get<std::string>());
    }
    std::size_t compared = 0;
    for (const std::string &name : names) {
      const auto file = fetcher.file(json["hash"].get<std::string>(), name);
      ASSERT_TRUE(file) << name;
      const auto content = base::read_file(*file);
      ASSERT_TRUE(content) << name;
      compared += bundle.files.count(casefile::sha256(*content));
    }
    EXPECT_EQ(compared, bundle.files.size());
  }

  std::optional<Ethernet> lan_;
  std::atomic<std::uint32_t> offer_{0};
  std::mutex mutex_;
  std::vector<double> delays_ms_;
  std::optional<HostThread> server_;
  std::optional<HostThread> states_;
  std::optional<HostThread> watch_;
};

TEST_F(RemoteCase, TheCaseArrivesWholeAlsoWithLossAndStatesGoOn) {
  start_daemon_host();
  std::this_thread::sleep_for(2s);
  std::printf("%-12s %10s %22s %22s\n", "loss", "case s", "states p99 ms before", "states p99 ms during");
  std::uint32_t seed = 1;
  for (const double loss : {0.0, 0.01}) {
    lan_->set_fault(kDisplayHost, {.loss = loss});
    (void)p99_ms();
    std::this_thread::sleep_for(3s);
    const double before_ms = p99_ms();
    const auto seconds = fetch(seed++);
    const double during_ms = p99_ms();
    ASSERT_TRUE(seconds);
    std::printf("%-12.2f %10.2f %22.2f %22.2f\n", loss, *seconds, before_ms, during_ms);
  }
}

} // namespace
} // namespace bregma::test
