// A scanner with its coil controller and registration frame for tests of the scanner's stage, in virtual time: stacks
// are drawn (balls of lost signal, a grid phantom), commands are answered, slices are put on the topic a few at a time.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/coil_frame.hpp"
#include "algorithms/mri/frames.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/host.hpp"
#include "server/stages/scanner/stage.hpp"
#include "tests/support/memory_topics.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::server::testing {

inline constexpr std::int64_t kStart_ns = 1'800'000'000'000'000'000;
inline constexpr std::int64_t kTick_ns = 50'000'000;

// Eleven coils without symmetry: four top, four bottom, three that verify.
[[nodiscard]] mri::CoilFrame test_frame();
// Control points of the phantom in CT: 5 x 5 x 5 crossings, 15 mm apart.
[[nodiscard]] geometry::Points3 phantom_points();
// By how much the scanner of the tests shifts a point at p (Device, mm): smooth, up to about 2 mm.
[[nodiscard]] Eigen::Vector3d test_distortion(const Eigen::Vector3d &p);

class FakeScanner {
public:
  using Pixels = std::vector<std::uint16_t>; // of a whole stack

  explicit FakeScanner(test::MemoryTopics &topics);

  // Puts what is due now. Call before every step of the stage.
  void advance(std::int64_t now_ns);
  // Slices of a series that nobody ordered.
  void send_live(const std::string &protocol, std::uint32_t count, std::int64_t now_ns);

  // What a driver states about itself, from now on once per step.
  void health(std::int64_t started_ns, std::uint64_t connections, wire::DriverState state,
              const char *device = "Scanner");
  // Slices come from another program from now on.
  void other_program() { ++writer_; }
  // Its program ends, with all orders, and another one begins to count.
  void restart();

  // ---- what happens ----
  std::function<void(wire::ImageSlice &)> change = [](wire::ImageSlice &) {}; // every slice
  std::set<int> dark;                                                         // coils without current
  std::map<std::string, std::string> cables;                                  // pattern: what it really switches
  Eigen::Vector3d frame_moved_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d phantom_moved_mm = Eigen::Vector3d::Zero(); // from the next scan of it on
  double table_mm = 0.0;
  double saturation = 65535.0; // of foregrounds
  bool distorts = false;
  // Device; along x, by the pixel per kBandwidth_Hz, against it for protocols "-reversed". Empty: none, and no slice
  // states its bandwidth.
  std::function<double(const Eigen::Vector3d &)> b0_Hz;
  static constexpr double kBandwidth_Hz = 100.0;
  bool answers = true;
  std::string refuse_coils; // pattern that the controller refuses

  // ---- what was ordered ----
  std::vector<std::string> patterns, protocols;
  [[nodiscard]] bool coils_on() const { return pattern_ != "background"; }
  mri::Rigid3<mri::frame::Device, mri::frame::Base> T_device_base;

private:
  struct Series {
    std::shared_ptr<const Pixels> pixels;
    wire::ImageSlice header{};
    std::optional<wire::Command> command;
    std::uint32_t sent = 0;
  };
  void take(const wire::Command &command);
  void reply(const wire::Command &command, wire::CommandResult result, const std::string &text);
  [[nodiscard]] std::shared_ptr<const Pixels> frame_stack(const std::string &pattern, bool reversed = false);
  [[nodiscard]] std::shared_ptr<const Pixels> phantom_stack(std::uint32_t slices, bool reversed) const;
  // By how much a point is shown too far, in pixels of this size.
  [[nodiscard]] Eigen::Vector3d displacement(const Eigen::Vector3d &p, double pixel_mm, bool reversed) const;

  test::MemoryTopics &topics_;
  std::int64_t now_ns_ = kStart_ns;
  std::string pattern_ = "background";
  std::vector<wire::Command> commands_;
  std::vector<Series> series_;
  std::vector<std::shared_ptr<const Pixels>> kept_; // slices on the topic refer to them
  std::uint32_t number_ = 0;
  std::uint64_t frame_ = 0;
  std::uint64_t writer_ = 1; // identity of its program
  std::map<std::string, wire::DriverHealth> health_;
};

// Runs long work at once, or later.
class LaterHost final : public Host {
public:
  bool later = false;
  std::vector<std::function<void()>> jobs;
  void run_elsewhere(Work /*work*/, const std::function<void()> &job) override {
    if (later) {
      jobs.push_back(job);
    } else {
      job();
    }
  }
};

// The stage with its inputs, and a fake scanner; steps in virtual time.
class ScannerBench {
public:
  explicit ScannerBench(bool with_phantom = false, bool opposed_read_outs = false);

  // Sends a command and returns the answer.
  StageAnswer command(wire::CommandKind kind, std::initializer_list<std::string_view> values);
  StageAnswer confirm(const char *step) { return command(bregma_wire_COMMAND_CONFIRM_SCANNER_STEP, {"Scanner", step}); }
  void step();
  // Steps until the procedure waits for the operator or has failed; false after 120 s.
  bool settle();
  // From the start to the step "accept", or to the failure.
  const wire::ScannerRegistration &procedure();
  void let_pass(std::int64_t ns) { now.utc_ns += ns, now.monotonic_ns += ns, now.boot_ns += ns; }

  test::TemporaryFolder folder;
  test::MemoryTopics topics;
  FakeScanner scanner{topics};
  Moment now{.utc_ns = kStart_ns, .monotonic_ns = kStart_ns, .boot_ns = kStart_ns};
  LaterHost host;
  ScannerInbox inbox;
  runtime::LatestValue<RobotToolsView> tools;
  wire::ScannerRegistration state{};
  std::vector<wire::CorrectedSlice> corrected; // without their pixels
  std::vector<std::uint16_t> corrected_pixels; // of the last one
  std::set<std::string> alarms;                // raised
  std::unique_ptr<ScannerStage> stage;

  // Error of the mapped origin of the base, mm.
  [[nodiscard]] double target_error_mm(const wire::Pose &T_base_scanner) const;
};

} // namespace bregma::server::testing
