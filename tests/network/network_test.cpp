// Faults of the network between the daemon, a driver and clients: real processes on hosts of their own (ethernet.hpp),
// with the configuration that is shipped. Prints the figures of each fault.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "idl/validity.hpp"
#include "tests/component/operation_fixture.hpp"
#include "tests/network/display.hpp"
#include "tests/network/ethernet.hpp"

namespace bregma::test {
namespace {

using namespace std::chrono_literals;

enum Host : std::size_t { kDaemonHost, kDriverHost, kClientHost, kOtherHost, kHosts };

struct Fault {
  const char *name;
  LinkFault link;
  double seconds;
};

const Fault kFaults[] = {{"cut 1 s", {.cut = true}, 1.0},
                         {"delay 20 ms", {.delay = 20ms}, 3.0},
                         {"loss 1 %", {.loss = 0.01}, 3.0},
                         {"loss 5 %", {.loss = 0.05}, 3.0},
                         {"loss 20 %", {.loss = 0.2}, 3.0},
                         {"reordering 20 %", {.reordering = 0.2}, 3.0},
                         {"duplication 20 %", {.duplication = 0.2}, 3.0},
                         {"cut 5 s", {.cut = true}, 5.0},
                         {"cut 15 s", {.cut = true}, 15.0}};

constexpr double kMaxGap_ms = 100.0;     // at displays whose own link is sound
constexpr double kMaxRecovery_s = 3.0;   // until the pose is live again
constexpr double kAgeTolerance_ms = 5.0; // the daemon's age may be too small by this (device clocks)

struct Figures {
  double gap_ms = 0.0;    // longest time without a state of the probe
  double own_ms = 0.0;    // longest period of the display itself: a busy machine
  double hidden_ms = 0.0; // longest time without a pose
  double age_ms = 0.0;    // largest true age of a pose while it was shown
};

Figures figures_of(const std::vector<DisplayRecord> &records, const Truth &truth) {
  Figures out;
  if (records.empty()) {
    return out;
  }
  std::int64_t arrived_ns = records.front().time_ns;
  std::int64_t shown_ns = records.front().time_ns;
  std::int64_t last_ns = records.front().time_ns;
  const auto raise = [](double &value, std::int64_t ns) { value = std::max(value, static_cast<double>(ns) * 1e-6); };
  for (const DisplayRecord &record : records) {
    raise(out.own_ms, record.time_ns - std::exchange(last_ns, record.time_ns));
    raise(out.gap_ms, record.time_ns - arrived_ns);
    raise(out.hidden_ms, record.time_ns - shown_ns);
    arrived_ns = record.arrived > 0 ? record.time_ns : arrived_ns;
    if (record.shown_frame) {
      shown_ns = record.time_ns;
      const auto exposed_ns = truth.exposed_ns(*record.shown_frame);
      raise(out.age_ms, exposed_ns ? record.time_ns - *exposed_ns : 0);
    }
  }
  return out;
}

// Numbers of the tracker's frames that the daemon cannot account for; constant while it counts every loss.
std::optional<std::int64_t> unaccounted(Operation &operation) {
  const wire::DeviceHealth *tracker = operation.device("Tracker");
  if (tracker == nullptr || operation.probe.empty()) {
    return std::nullopt;
  }
  std::uint64_t known = tracker->taken + tracker->lost;
  for (std::size_t reason = 0; reason < std::size(tracker->rejected); ++reason) {
    known += reason == bregma_wire_REJECT_DUPLICATE ? 0 : tracker->rejected[reason];
  }
  return static_cast<std::int64_t>(operation.probe.back().frame) - static_cast<std::int64_t>(known);
}

class Network : public ::testing::Test {
protected:
  void SetUp() override {
    if (const std::string why = Ethernet::unavailable(); !why.empty()) {
      GTEST_SKIP() << "this process cannot make hosts on a network: " << why;
    }
    lan_.emplace(kHosts, kSeed);
    lan_->run_on(kDaemonHost, [this] { prepare(); });
    ASSERT_TRUE(operation_->observe_until(
        [&] { return operation_->health.session == bregma_wire_SESSION_NAVIGATING && all_show(); }, 90.0))
        << operation_->logs();
  }

  // Daemon and driver as processes, each display as a domain instance of its own in this process.
  void prepare() {
    const std::uint32_t domain = operation_domain();
    std::string uri = "file://" BREGMA_SOURCE_DIR "/deploy/cyclonedds-network.xml";
    for (std::uint32_t instance = kFirstInstance; instance < kFirstInstance + kHosts + 1; ++instance) {
      uri += ",<CycloneDDS><Domain Id=\"" + std::to_string(instance) + "\"><Discovery><ExternalDomainId>" +
             std::to_string(domain) + "</ExternalDomainId></Discovery></Domain></CycloneDDS>";
    }
    setenv("CYCLONEDDS_URI", uri.c_str(), 1);
    operation_.emplace();
    register_in_virtual_time(operation_->case_folder(), operation_->state_folder().string());
    operation_->start_daemon();
    for (const Host host : {kDaemonHost, kClientHost, kOtherHost}) {
      displays_[host] = std::make_unique<Display>(*lan_, host, kFirstInstance + host);
    }
    truth_ = std::make_unique<Truth>(*lan_, kDriverHost, kFirstInstance + kDriverHost);
    lan_->run_on(kDriverHost, [this] {
      std::string steps = kNavigateSteps;
      const std::string duration = "duration_s = 60.0";
      steps.replace(steps.find(duration), duration.size(), "duration_s = 400.0");
      operation_->start_room(steps);
    });
  }

  [[nodiscard]] bool all_show() const {
    return std::all_of(displays_.begin(), displays_.end(), [](const auto &one) { return !one || one->shows(); });
  }

  void disturb(Host host) {
    std::optional<std::int64_t> expected;
    std::printf("%-17s %-12s %9s %9s %9s %9s\n", "fault", "display at", "gap ms", "hidden ms", "age ms", "period ms");
    for (const Fault &fault : kFaults) {
      SCOPED_TRACE(fault.name);
      for (const auto &display : displays_) {
        if (display) {
          (void)display->take_records();
        }
      }
      lan_->set_fault(host, fault.link);
      operation_->observe_for(fault.seconds);
      if (fault.link.cut && host == kDriverHost) { // nothing is under way
        const auto counted = unaccounted(*operation_);
        EXPECT_TRUE(counted);
        EXPECT_EQ(expected.value_or(*counted), *counted) << "a loss was not counted, or counted twice";
        expected = counted;
      }
      lan_->set_fault(host, {});
      const auto began = std::chrono::steady_clock::now();
      EXPECT_TRUE(operation_->observe_until([&] { return all_show(); }, 30.0)) << operation_->logs();
      const double recovery_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
      operation_->observe_for(1.0);
      EXPECT_TRUE(all_show());
      report(host, fault, recovery_s);
    }
  }

  void report(Host host, const Fault &fault, double recovery_s) {
    constexpr const char *kNames[] = {"daemon", "driver", "client", "other client"};
    for (std::size_t at = 0; at < displays_.size(); ++at) {
      if (!displays_[at]) {
        continue;
      }
      const Figures figures = figures_of(displays_[at]->take_records(), *truth_);
      std::printf("%-17s %-12s %9.1f %9.1f %9.1f %9.1f\n", fault.name, kNames[at], figures.gap_ms, figures.hidden_ms,
                  figures.age_ms, figures.own_ms);
      EXPECT_LE(figures.age_ms, wire::kLiveLimit_ms + kAgeTolerance_ms + figures.own_ms) << kNames[at];
      // A daemon whose cable is pulled still serves the displays of its own host: its writers do not block.
      if ((host == kClientHost && at != kClientHost) || (host == kDaemonHost && at == kDaemonHost)) {
        EXPECT_LE(figures.gap_ms, kMaxGap_ms + figures.own_ms) << kNames[at];
      }
    }
    std::printf("%-17s live again after %.2f s\n", fault.name, recovery_s);
    EXPECT_LE(recovery_s, kMaxRecovery_s);
  }

  static constexpr std::uint32_t kFirstInstance = 1000;
  std::optional<Ethernet> lan_;
  std::optional<Operation> operation_; // its observer is on the daemon's host
  std::array<std::unique_ptr<Display>, kHosts> displays_;
  std::unique_ptr<Truth> truth_;
};

TEST_F(Network, FaultsOfAClientsLinkDisturbNoOtherClient) { disturb(kClientHost); }
TEST_F(Network, FaultsOfTheDriversLinkShowNothingOldAndEveryLossIsCounted) { disturb(kDriverHost); }
TEST_F(Network, FaultsOfTheDaemonsLinkShowNothingOld) { disturb(kDaemonHost); }

} // namespace
} // namespace bregma::test
