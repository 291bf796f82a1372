// `bregma robot`: the scan of the skin by a range sensor that an arm carries, and motions of the arm.
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/command_reply.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/robot_motions.hpp"
#include "clients/cli/robot_pose.hpp"

namespace bregma::cli {

namespace {

struct ScanArguments {
  std::string arm = "Robot";
  std::string sensor = "Range";
  double spacing_mm = 0.0;
};

CLI::App *add_leaf(CLI::App &parent, const char *name, const char *text, ScanArguments &arguments, Context &context) {
  auto *command = parent.add_subcommand(name, text);
  command->add_option("--arm", arguments.arm, "The arm of the case")->capture_default_str();
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  return command;
}

} // namespace

void add_robot_command(CLI::App &app, Context &context) {
  auto *robot = app.add_subcommand("robot", "An arm that registers and navigates without a tracker");
  robot->require_subcommand(1);
  robot->footer("Examples:\n  bregma register start\n  bregma robot scan start --sensor Range\n"
                "  bregma robot scan move --width-mm 100 --height-mm 110\n  bregma robot scan stop\n  bregma register "
                "accept\n  bregma robot move Biopsy --standoff-mm 50");
  add_robot_motions(*robot, context);
  add_robot_pose(*robot, context);
  auto *scan = robot->add_subcommand("scan", "Samples of the skin by the range sensor at the flange");
  scan->require_subcommand(1);

  const auto arguments = std::make_shared<ScanArguments>();
  auto *start = add_leaf(*scan, "start", "Starts a scan: its points join the registration, or check for drift",
                         *arguments, context);
  start->add_option("--sensor", arguments->sensor, "A sensor of the file robot.tools of the case")
      ->capture_default_str();
  start->add_option("--spacing-mm", arguments->spacing_mm, "Between samples; 0: as configured (trace.spacing_mm)")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  start->callback([arguments, &context] {
    context.run = [arguments, &context] {
      return send_and_show(
          live::make_command(bregma_wire_COMMAND_START_SURFACE_SCAN,
                             {arguments->arm, arguments->sensor, "0", std::to_string(arguments->spacing_mm)}),
          context);
    };
  });

  add_scan_motion(*scan, context);
  auto *stop = add_leaf(*scan, "stop", "Stops the scan", *arguments, context);
  stop->callback([arguments, &context] {
    context.run = [arguments, &context] {
      return send_and_show(live::make_command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {arguments->arm}), context);
    };
  });
}

} // namespace bregma::cli
