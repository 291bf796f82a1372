// The whole registration of a robot to a scanner over DDS: the daemon, an operating room with a robot, the simulated
// scanner with its coils, and an operator who follows what the daemon asks. Afterwards slices are corrected with the
// robot's tip in them, and the recording has it all.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <csignal>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "algorithms/geometry/rigid3.hpp"
#include "casefile/session_file/session_file.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

struct RobotBase;
struct ScannerDevice;
struct ToolTip;
using geometry::Rigid3;

constexpr double kSlowest_s = kSanitized ? 580.0 : 240.0; // of one wait

// A program that runs to its end.
void run_to_end(const std::vector<std::string> &command, const std::string &log) {
  Process process(command, log);
  const auto status = process.wait(kSlowest_s);
  ASSERT_TRUE(status && *status == 0) << command.front() << "\n" << process.log();
}

class ScannerOverDds : public testing::Test {
protected:
  void start() {
    const std::string folder = files.path().string();
    ASSERT_NO_FATAL_FAILURE(run_to_end({BREGMA_SIM_SCANNER, "--write", folder, "--no-mr", "--phantom", "--seed", "3"},
                                       folder + "/sim-scanner.log"));
    ASSERT_NO_FATAL_FAILURE(run_to_end({BREGMA_PROGRAM, "mri", "points", folder + "/phantom_ct.nrrd", "-o",
                                        folder + "/ct.mrk.json", "--ct", "--cell-mm", "16.91", "--bar-mm", "1.91"},
                                       folder + "/points.log"));
    std::ofstream(folder + "/tools.toml")
        << "[[tools]]\nname = \"Guide\"\ntip_mm = [0, 0, 100]\naxis = [0, 0, 1]\nsigma_mm = 0.1\n";
    operation.start_daemon({"scanner.frame=" + folder + "/frame.toml", "scanner.phantom=" + folder + "/ct.mrk.json",
                            "scanner.cell_mm=16.91", "scanner.bar_mm=1.91", "robot.tools=" + folder + "/tools.toml",
                            "robot.tool=Guide"});
    operation.start_room(R"(
[[steps]]
do = "load_case"
[[steps]]
do = "pivot"
tool = "Stylus"
duration_s = 600.0
)");
    scanner.emplace(std::vector<std::string>{BREGMA_SIM_MRI, "--set", "domain_id=" + std::to_string(operation.domain()),
                                             "--set", "seed=3", "--set", "plays_coils=true", "--set", "slice_ms=1"},
                    folder + "/sim-mri.log");
    ASSERT_TRUE(until([&] { return operation.device("Robot") != nullptr && state && commands.matched_readers() >= 2; }))
        << logs();
  }

  bool until(const std::function<bool()> &done) {
    return operation.observe_until(
        [&] {
          states.take_each([&](const wire::ScannerRegistration &s, const auto &) { state = s; });
          tools.take_each([&](const wire::RobotTool &s, const auto &) { tool = s; });
          slices.take_each([&](const wire::CorrectedSlice &s, const auto &) {
            corrected.push_back(s);
            corrected.back().slice.pixels = {};
          });
          replies.take_each([&](const wire::CommandReply &s, const auto &) {
            if (wire::view(s.client) == "operator") {
              reply = s;
            }
          });
          return done();
        },
        kSlowest_s);
  }
  // Sends a command, and waits for its reply.
  void command(wire::CommandKind kind, std::initializer_list<std::string_view> values, const char *receiver = "") {
    wire::Command out{};
    ASSERT_EQ(wire::fill_command(out, kind, values), "");
    ASSERT_TRUE(wire::set_name(out.client, "operator") && wire::set_name(out.receiver, receiver));
    out.id = ++id;
    ASSERT_TRUE(commands.write(out));
    ASSERT_TRUE(until([&] { return reply && reply->id == id; })) << logs();
    ASSERT_EQ(reply->result, bregma_wire_COMMAND_DONE) << reply->text;
  }
  [[nodiscard]] bool waits_in(wire::ScannerStep step) const {
    return state->step == step && state->activity == bregma_wire_SCANNER_WAITS;
  }
  // The daemon waits for the operator in this step.
  void expect_wait(wire::ScannerStep step) {
    ASSERT_TRUE(until([&] { return waits_in(step) || state->activity == bregma_wire_SCANNER_FAILED; })) << logs();
    ASSERT_TRUE(waits_in(step)) << "step " << state->step << ": " << state->text;
  }
  [[nodiscard]] std::string logs() const {
    return operation.logs() + (scanner ? "scanner:\n" + scanner->log() : std::string()) +
           (state ? std::string("state: ") + state->text : std::string("no state"));
  }
  [[nodiscard]] Rigid3<ScannerDevice, RobotBase> true_pose() const {
    std::ifstream in(files.path() / "truth.json");
    const auto truth = nlohmann::json::parse(in);
    Eigen::Matrix4d T;
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) {
        T(r, c) = truth.at("T_device_base").at(static_cast<std::size_t>(r)).at(static_cast<std::size_t>(c));
      }
    }
    return {Eigen::Matrix3d(T.topLeftCorner<3, 3>()), Eigen::Vector3d(T.topRightCorner<3, 1>())};
  }

  TemporaryFolder files;
  Operation operation;
  dds::Participant participant{operation.domain()};
  dds::Writer<wire::Command> commands{participant};
  dds::Reader<wire::CommandReply> replies{participant};
  dds::Reader<wire::ScannerRegistration> states{participant};
  dds::Reader<wire::RobotTool> tools{participant};
  dds::Reader<wire::CorrectedSlice> slices{participant};
  std::optional<Process> scanner;
  std::optional<wire::ScannerRegistration> state;
  std::optional<wire::RobotTool> tool;
  std::optional<wire::CommandReply> reply;
  std::vector<wire::CorrectedSlice> corrected; // without pixels
  std::uint64_t id = 0;
};

TEST_F(ScannerOverDds, IsGuidedFromThePhantomToCorrectedSlicesWithTheRobotsTip) {
  ASSERT_NO_FATAL_FAILURE(start());
  ASSERT_TRUE(until([&] { return tool && tool->status == bregma_wire_POSE_LIVE; })) << logs();
  EXPECT_EQ(tool->scanner_status, bregma_wire_POSE_NOT_REGISTERED);
  EXPECT_TRUE(std::isnan(tool->T_scanner_tip.translation_mm[0]));

  ASSERT_NO_FATAL_FAILURE(command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}));
  ASSERT_NO_FATAL_FAILURE(expect_wait(bregma_wire_SCANNER_STEP_SWAP));
  EXPECT_EQ(state->field_status, bregma_wire_FIELD_VALID);
  EXPECT_GE(state->field_points, 1'320U) << "of 1,331";
  EXPECT_LT(state->field_residual_mm, 0.25);
  ASSERT_NO_FATAL_FAILURE(command(bregma_wire_COMMAND_CONFIRM_SCANNER_STEP, {"Scanner", "swap"}));
  ASSERT_NO_FATAL_FAILURE(expect_wait(bregma_wire_SCANNER_STEP_ACCEPT));
  EXPECT_EQ(state->verdict, bregma_wire_SCANNER_VERDICT_FOUND) << state->reason;
  EXPECT_TRUE(corrected.empty()) << "slices of the procedure are not published";
  ASSERT_NO_FATAL_FAILURE(command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {"Scanner"}));
  ASSERT_NO_FATAL_FAILURE(expect_wait(bregma_wire_SCANNER_STEP_DONE));
  ASSERT_EQ(state->validity, bregma_wire_SCANNER_VALID);

  // Against the truth, which only the simulation knows.
  const auto T_base_scanner = wire::from_wire<RobotBase, ScannerDevice>(state->accepted_T_base_scanner);
  const double error_mm = (T_base_scanner * true_pose().translation()).norm();
  EXPECT_LT(error_mm, 1.5 * state->accepted_tre_95_mm);
  EXPECT_LT(error_mm, 1.0);

  // The robot's tool is now known in the scanner.
  ASSERT_TRUE(until([&] { return tool->scanner_status == bregma_wire_POSE_LIVE; })) << logs();
  const auto T_base_tip = wire::from_wire<RobotBase, ToolTip>(tool->T_base_tip);
  const auto T_scanner_tip = wire::from_wire<ScannerDevice, ToolTip>(tool->T_scanner_tip);
  EXPECT_LT((T_base_scanner * T_scanner_tip.translation() - T_base_tip.translation()).norm(), 1e-6);
  EXPECT_GT(tool->scanner_error_95_mm, state->accepted_tre_95_mm) << "the tip is far from the target";

  ASSERT_NO_FATAL_FAILURE(command(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "tree-coronal", "12"}, "Scanner"));
  // The topic keeps the newest only: which of those before the last one are seen is up to the machine.
  ASSERT_TRUE(until([&] { return !corrected.empty() && corrected.back().slice.index == 12; })) << logs();
  for (const wire::CorrectedSlice &slice : corrected) {
    EXPECT_NE(slice.slice.correction, bregma_wire_CORRECTION_NONE);
    EXPECT_GT(slice.max_shift_mm, 0.2);
    EXPECT_EQ(slice.tip_status, bregma_wire_POSE_LIVE);
    EXPECT_EQ(wire::view(slice.tip_tool), "Guide");
    EXPECT_TRUE(std::isfinite(slice.tip_pixel[0]) && std::isfinite(slice.tip_distance_mm));
  }

  // The recording: every step, and the tool before and after the registration.
  operation.daemon().signal(SIGTERM);
  ASSERT_EQ(operation.daemon().wait(60.0), 0) << logs();
  const auto sessions = operation.case_folder().loaded().folder / "sessions";
  std::filesystem::path file;
  for (const auto &entry : std::filesystem::directory_iterator(sessions)) {
    file = entry.path().extension() == ".db" ? entry.path() : file;
  }
  const auto session = casefile::SessionReader::open(file);
  ASSERT_TRUE(session) << session.error().message;
  std::vector<wire::ScannerStep> steps;
  std::optional<wire::ScannerRegistration> recorded;
  ASSERT_TRUE(session->each<wire::ScannerRegistration>([&](const wire::ScannerRegistration &s, std::int64_t) {
    if (steps.empty() || steps.back() != s.step) {
      steps.push_back(s.step);
    }
    recorded = s;
  }));
  for (const wire::ScannerStep step :
       {bregma_wire_SCANNER_STEP_PHANTOM, bregma_wire_SCANNER_STEP_SWAP, bregma_wire_SCANNER_STEP_TOP,
        bregma_wire_SCANNER_STEP_BOTTOM, bregma_wire_SCANNER_STEP_VERIFY, bregma_wire_SCANNER_STEP_ACCEPT}) {
    EXPECT_NE(std::find(steps.begin(), steps.end(), step), steps.end()) << step;
  }
  ASSERT_TRUE(recorded);
  EXPECT_EQ(recorded->validity, bregma_wire_SCANNER_VALID);
  EXPECT_EQ(std::string_view(recorded->coils[0].coil), std::string_view(state->coils[0].coil));
  std::map<wire::PoseStatus, int> statuses;
  ASSERT_TRUE(
      session->each<wire::RobotTool>([&](const wire::RobotTool &s, std::int64_t) { ++statuses[s.scanner_status]; }));
  EXPECT_GT(statuses[bregma_wire_POSE_NOT_REGISTERED], 0);
  EXPECT_GT(statuses[bregma_wire_POSE_LIVE], 0);
}

} // namespace
} // namespace bregma::test
