// The commands of `bregma`: each file adds its own to the program and stores the function to run in the context.
#pragma once

#include <cstdint>
#include <functional>

namespace CLI {
class App;
}

namespace bregma::cli {

// Exit codes of all commands.
enum ExitCode : int {
  kOk = 0,
  kRefused = 1,  // the command ran with a negative result: verdict not passed, command refused, limit exceeded
  kBadInput = 2, // the command could not run: usage, unreadable file, no daemon
};

// Filled while the command line is parsed. A command's callback sets run; main calls it once parsing has succeeded.
struct Context {
  bool json = false;        // --json: one JSON document on standard output (watch: one per line)
  std::uint32_t domain = 0; // --domain: DDS domain of the daemon
  double wait_s = 3.0;      // --wait: for a daemon that has not started yet
  std::function<int()> run; // returns an ExitCode; may throw, main turns that into one sentence and kBadInput
};

// --json is on every command: call it for each leaf command.
void add_json_flag(CLI::App &command, Context &context);
// --domain and --wait, for commands that talk to a daemon.
void add_daemon_options(CLI::App &command, Context &context);

void add_case_command(CLI::App &app, Context &context);      // case ...
void add_calibrate_command(CLI::App &app, Context &context); // calibrate pivot ...
void add_arm_command(CLI::App &app, Context &context);       // arm ...
void add_register_command(CLI::App &app, Context &context);  // register ...
void add_live_commands(CLI::App &app, Context &context);     // status, watch, alarms, target
void add_robot_command(CLI::App &app, Context &context);     // robot ...
void add_mri_command(CLI::App &app, Context &context);       // mri ...
void add_tissue_command(CLI::App &app, Context &context);    // tissue ...
void add_image_command(CLI::App &app, Context &context);     // image ...
void add_report_command(CLI::App &app, Context &context);    // report
void add_export_command(CLI::App &app, Context &context);    // export
void add_doctor_command(CLI::App &app, Context &context);    // doctor, completion

} // namespace bregma::cli
