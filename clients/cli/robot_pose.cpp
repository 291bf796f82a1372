#include "clients/cli/robot_pose.hpp"

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "base/write_file.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/standing_pose.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"

namespace bregma::cli {

namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

struct PoseArguments {
  std::string flange, body;
  std::string arm = "Robot", tracker = "Tracker", tool;
  double seconds = 0.5;
};

// As casefile::read_pose_matrices reads it: four rows, in a file that is named by its time.
template <class Pose> base::Result<void> write_pose(const fs::path &folder, std::int64_t time_ns, const Pose &pose) {
  std::error_code error;
  fs::create_directories(folder, error); // the file says what is wrong
  const Eigen::Matrix4d matrix = pose.matrix();
  std::string text;
  for (Eigen::Index row = 0; row < 4; ++row) {
    for (Eigen::Index column = 0; column < 4; ++column) {
      char number[40];
      std::snprintf(number, sizeof number, "%.12g%c", matrix(row, column), column < 3 ? ' ' : '\n');
      text += number;
    }
  }
  return base::write_file(folder / (std::to_string(time_ns) + ".txt"), text);
}

bool is_seen(const wire::TrackedTool &tool) {
  return tool.status == bregma_wire_TOOL_VISIBLE || tool.status == bregma_wire_TOOL_PARTLY_VISIBLE;
}

int record_pose(const PoseArguments &arguments, const Context &context) {
  const live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  dds::Reader<wire::RobotState> states(link.participant());
  dds::Reader<wire::TrackerFrame> frames(link.participant());
  std::vector<StandingFlange> flanges;
  std::vector<StandingBody> bodies;
  std::int64_t begin_ns = 0; // both have been heard
  std::int64_t time_ns = 0;
  const std::int64_t give_up_ns = live::Now::read().boot_ns + static_cast<std::int64_t>(1e9 * context.wait_s);
  bool arm_heard = false, tracker_heard = false;
  const auto interval_ns = static_cast<std::int64_t>(1e9 * arguments.seconds);
  for (;;) {
    const live::Now now = live::Now::read();
    if (begin_ns == 0 && arm_heard && tracker_heard) {
      begin_ns = now.boot_ns;
      flanges.clear(); // of the time before
      bodies.clear();
    }
    if (begin_ns != 0 ? now.boot_ns - begin_ns > interval_ns : now.boot_ns > give_up_ns) {
      time_ns = now.utc_ns;
      break;
    }
    states.take_each([&](const wire::RobotState &state, const dds::SampleInfo & /*info*/) {
      if (wire::view(state.device) == arguments.arm) {
        arm_heard = true;
        flanges.push_back(
            wire::from_wire<geometry::frame::RobotBase, geometry::frame::RobotFlange>(state.T_base_flange));
      }
    });
    frames.take_each([&](const wire::TrackerFrame &frame, const dds::SampleInfo & /*info*/) {
      tracker_heard = tracker_heard || wire::view(frame.device) == arguments.tracker;
      for (std::uint32_t i = 0; i < frame.tool_count; ++i) {
        const wire::TrackedTool &tool = frame.tools[i];
        if (wire::view(frame.device) == arguments.tracker && wire::view(tool.tool) == arguments.tool && is_seen(tool)) {
          bodies.push_back(wire::from_wire<geometry::frame::Tracker, geometry::frame::Tool>(tool.T_tracker_tool));
        }
      }
    });
    std::this_thread::sleep_for(5ms);
  }
  if (!tracker_heard) {
    return fail("no frame of \"" + arguments.tracker + "\" on domain " + std::to_string(context.domain));
  }
  const auto pair = standing_pair(flanges, bodies);
  if (!pair) {
    return fail(pair.error());
  }
  for (const auto &written : {write_pose(arguments.flange, time_ns, pair->T_base_flange),
                              write_pose(arguments.body, time_ns, pair->T_tracker_body)}) {
    if (!written) {
      return fail(written.error());
    }
  }
  if (context.json) {
    print_json({{"time_ns", time_ns}, {"flanges", flanges.size()}, {"frames", bodies.size()}});
  } else {
    print("pose " + std::to_string(time_ns) + ": mean of " + std::to_string(flanges.size()) + " samples of " +
          arguments.arm + " and " + std::to_string(bodies.size()) + " frames with " + arguments.tool + "\n");
  }
  return kOk;
}

} // namespace

void add_robot_pose(CLI::App &robot, Context &context) {
  const auto arguments = std::make_shared<PoseArguments>();
  auto *pose = robot.add_subcommand("pose", "Records where the standing arm and the tracked body on its flange are");
  pose->add_option("flange", arguments->flange, "Folder that receives the pose of the flange")->required();
  pose->add_option("body", arguments->body, "Folder that receives the pose of the body")->required();
  pose->add_option("--tool", arguments->tool, "The tracked body on the flange")->required();
  pose->add_option("--arm", arguments->arm, "The arm's device")->capture_default_str();
  pose->add_option("--tracker", arguments->tracker, "The tracker's device")->capture_default_str();
  pose->add_option("--seconds", arguments->seconds, "Of which the mean is taken")
      ->check(CLI::Range(0.1, 60.0))
      ->capture_default_str();
  pose->footer(
      "Lead the arm to about twenty places, turned about different axes by 20 degrees or more, and record each "
      "where it\n"
      "stands. No daemon is needed.\n\nExamples:\n"
      "  bregma robot pose flange body --tool Marker\n"
      "  bregma calibrate hand-eye flange body --json > hand_eye.json");
  add_json_flag(*pose, context);
  add_daemon_options(*pose, context);
  pose->callback(
      [arguments, &context] { context.run = [arguments, &context] { return record_pose(*arguments, context); }; });
}

} // namespace bregma::cli
