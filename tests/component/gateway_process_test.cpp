// bregma-gateway beside the real daemon and the simulated room, each of which stands still for a while. What a client
// of /state receives is never drawable for longer than the rule for live poses allows.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <sys/socket.h>

#include "idl/boot_clock.hpp"
#include "idl/validity.hpp"
#include "tests/component/operation_fixture.hpp"
#include "tests/unit/gateway/socket_client.hpp"

namespace bregma::test {
namespace {

using namespace std::chrono_literals;

double now_ms() { return static_cast<double>(wire::boot_now_ns()) * 1e-6; }

// Reads and acknowledges every frame, and keeps what it was told about the probe.
class Viewer {
public:
  explicit Viewer(std::uint16_t port) : client_(port), thread_([this] { run(); }) {}
  ~Viewer() {
    ::shutdown(client_.descriptor(), SHUT_RDWR);
    thread_.join();
  }
  Viewer(const Viewer &) = delete;
  Viewer &operator=(const Viewer &) = delete;

  // By the latest record and the present time, as a page decides whenever it draws.
  [[nodiscard]] bool draws() const {
    const std::lock_guard lock(mutex_);
    return valid_until_ms_ > now_ms(); // false for NaN
  }
  [[nodiscard]] std::uint32_t presence() const { return presence_; }
  [[nodiscard]] int shown_frames() const { return shown_; }
  [[nodiscard]] std::string wrong() const {
    const std::lock_guard lock(mutex_);
    return wrong_;
  }

private:
  void run() {
    try {
      for (;;) {
        read(client_.next());
      }
    } catch (const std::exception &) { // the end of the test
    }
  }

  void read(const std::string &frame) {
    gateway::FrameHeader header;
    std::memcpy(&header, frame.data(), sizeof header);
    gateway::RecordHeader record;
    for (std::size_t at = sizeof header; at < frame.size(); at += record.bytes) {
      std::memcpy(&record, frame.data() + at, sizeof record);
      const char *body = frame.data() + at + sizeof record;
      if (record.kind == static_cast<std::uint16_t>(gateway::RecordKind::kLink)) {
        gateway::Link link;
        std::memcpy(&link, body, sizeof link);
        presence_ = link.presence;
      } else if (record.kind == static_cast<std::uint16_t>(gateway::RecordKind::kTool)) {
        gateway::Tool tool;
        std::memcpy(&tool, body, sizeof tool);
        if (std::string(tool.tool) == "Probe") {
          take(tool, header);
        }
      }
    }
  }

  void take(const gateway::Tool &tool, const gateway::FrameHeader &header) {
    const std::lock_guard lock(mutex_);
    const bool pose = tool.status == bregma_wire_POSE_LIVE || tool.status == bregma_wire_POSE_UNVERIFIED;
    valid_until_ms_ = tool.valid_until_ms;
    shown_ += pose ? 1 : 0;
    const auto insist = [&](bool holds, const char *what) { wrong_ += holds ? "" : std::string(what) + "; "; };
    insist(pose == std::isfinite(tool.tip_mm[0]), "a tip without a pose, or a pose without a tip");
    insist(pose == std::isfinite(tool.valid_until_ms), "a pose without an end, or an end without a pose");
    insist(!pose || tool.valid_until_ms > header.written_ms, "a pose that was over when it was written");
    insist(!pose || tool.valid_until_ms - tool.acquired_ms <= static_cast<double>(wire::kMaxLiveAge_ns) * 1e-6 + 1e-3,
           "a pose that may be drawn for longer than any");
  }

  StateClient client_;
  mutable std::mutex mutex_;
  double valid_until_ms_ = 0.0;
  std::string wrong_;
  std::atomic<int> shown_{0};
  std::atomic<std::uint32_t> presence_{0};
  std::thread thread_;
};

// The port that the gateway prints; 0 until it has.
std::uint16_t port_of(const Process &gateway) {
  const std::string log = gateway.log();
  const auto at = log.find("localhost:");
  return at == std::string::npos || log.find('\n', at) == std::string::npos
             ? std::uint16_t{0}
             : static_cast<std::uint16_t>(std::stoi(log.substr(at + 10)));
}

TEST(GatewayProcess, NothingOldIsDrawableWhileTheDaemonTheDriverOrTheGatewayStandStill) {
  Operation operation;
  ASSERT_TRUE(operation.start_unverified()) << operation.logs();
  const TemporaryFolder folder;
  Process gateway({BREGMA_GATEWAY, "--domain", std::to_string(operation.domain()), "--port", "0", "--cache",
                   (folder / "cache").string()},
                  (folder / "gateway.log").string());
  ASSERT_TRUE(operation.observe_until([&] { return port_of(gateway) != 0; })) << gateway.log();
  Viewer viewer(port_of(gateway));
  const auto drawn_again = [&] {
    const int before = viewer.shown_frames();
    return operation.observe_until([&] { return viewer.shown_frames() > before + 10 && viewer.draws(); });
  };
  ASSERT_TRUE(drawn_again()) << gateway.log() << operation.logs();

  for (Process *stopped : {&operation.daemon(), &operation.room(), &gateway}) {
    stopped->signal(SIGSTOP);
    EXPECT_TRUE(operation.observe_until([&] { return !viewer.draws(); }));
    operation.observe_for(3.0);
    EXPECT_FALSE(viewer.draws()) << "it came back while " << stopped->pid() << " stood still";
    EXPECT_TRUE(stopped != &operation.daemon() || viewer.presence() == 1) << "a silent daemon is named";
    stopped->signal(SIGCONT);
    EXPECT_TRUE(drawn_again()) << "it continues without a new connection\n" << operation.logs();
  }
  EXPECT_EQ(viewer.wrong(), "");

  operation.daemon().signal(SIGKILL);
  EXPECT_TRUE(operation.observe_until([&] { return !viewer.draws() && viewer.presence() == 1; }));
  operation.start_daemon();
  EXPECT_TRUE(drawn_again()) << "as unverified, after a restart\n" << operation.logs();
  EXPECT_EQ(viewer.wrong(), "");
  gateway.signal(SIGTERM);
  EXPECT_EQ(gateway.wait(20.0), 0) << gateway.log();
}

} // namespace
} // namespace bregma::test
