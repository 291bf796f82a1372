// `bregma robot`: the scan of the skin by a range sensor that an arm carries, and motions of the arm.
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/command_reply.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/held_key.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/wire_labels.hpp"

namespace bregma::cli {

namespace {

struct ScanArguments {
  std::string arm = "Robot";
  std::string sensor = "Range";
  double spacing_mm = 0.0;
};

struct MoveArguments {
  std::string arm = "Robot";
  std::string trajectory;
  double standoff_mm = 50.0;
  double speed_mm_s = 20.0;
  bool hold = false; // the deadman, without a key
};

using namespace std::chrono_literals;

constexpr std::int64_t kDeadmanPeriod_ns = 50'000'000;
constexpr std::int64_t kDriverSilent_ns = 1'000'000'000;
constexpr std::int64_t kKeyWait_ns = 30'000'000'000;

// The motion that this client commanded, as its driver states it.
class Motion {
public:
  Motion(live::DaemonLink &link, std::string arm)
      : link_(link), arm_(std::move(arm)), states_(link.participant()), deadmen_(link.participant()) {}

  // Sends the deadman until the motion has ended; held() is asked every few milliseconds.
  template <class Held> base::Result<wire::RobotMotionState> follow(std::uint64_t id, Held &&held) {
    std::int64_t heard_ns = live::Now::read().boot_ns;
    std::int64_t next_ns = 0;
    for (;;) {
      const std::int64_t now_ns = live::Now::read().boot_ns;
      const bool permitted = held(now_ns);
      if (now_ns >= next_ns || !permitted) {
        send(id, permitted);
        next_ns = now_ns + kDeadmanPeriod_ns;
      }
      std::optional<wire::RobotMotionState> last;
      states_.take_each([&](const wire::RobotMotionState &state, const dds::SampleInfo & /*info*/) {
        if (wire::view(state.device) == arm_) {
          heard_ns = now_ns;
          last = state;
        }
      });
      if (last && last->motion_id == id && wire::view(last->motion_client) == link_.client() &&
          last->phase != bregma_wire_MOTION_WAITS && last->phase != bregma_wire_MOTION_UNDER_WAY) {
        return *last;
      }
      if (now_ns - heard_ns > kDriverSilent_ns) {
        return base::failure("the driver of " + arm_ + " is silent: the arm stops by itself");
      }
      (void)link_.update(5ms);
    }
  }

private:
  void send(std::uint64_t id, bool held) {
    wire::RobotDeadman out{};
    (void)wire::set_name(out.device, arm_);
    (void)wire::set_name(out.client, link_.client());
    out.motion_id = id;
    out.frame = ++frame_;
    out.sent_time_ns = live::Now::read().utc_ns;
    out.held = held;
    (void)deadmen_.write(out); // one that is lost is followed by the next
  }

  live::DaemonLink &link_;
  std::string arm_;
  dds::Reader<wire::RobotMotionState> states_;
  dds::Writer<wire::RobotDeadman> deadmen_;
  std::uint64_t frame_ = 0;
};

int show_motion(const base::Result<wire::RobotMotionState> &end, const Context &context) {
  if (!end) {
    return fail(end.error());
  }
  const bool done = end->phase == bregma_wire_MOTION_DONE;
  if (context.json) {
    print_json({{"done", done}, {"phase", end->phase}, {"cause", end->cause}, {"text", end->text}});
  } else if (done) {
    print(printable(end->text) + "\n");
  } else {
    (void)fail(printable(end->text));
  }
  return done ? kOk : kRefused;
}

int move_guide(const MoveArguments &arguments, const Context &context) {
  const auto command = live::make_command(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY,
                                          {arguments.arm, arguments.trajectory, std::to_string(arguments.standoff_mm),
                                           std::to_string(arguments.speed_mm_s)});
  if (!command) {
    return fail(command.error());
  }
  if (!arguments.hold && !HeldKey::available()) {
    return fail("the deadman is a key that is held down: standard input is no terminal (--hold: without a key)");
  }
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kCommands, context.wait_s);
  Motion motion(link, arguments.arm);
  std::optional<HeldKey> key;
  const auto held = [&](std::int64_t now_ns) { return !key || key->held(now_ns); };
  if (!arguments.hold) {
    if (!context.json) {
      print("Hold a key down: the arm moves while it is held. Ctrl-C ends.\n");
    }
    key.emplace();
    const std::int64_t end_ns = live::Now::read().boot_ns + kKeyWait_ns;
    while (!key->held(live::Now::read().boot_ns)) {
      if (key->interrupted() || live::Now::read().boot_ns > end_ns) {
        key.reset();
        return fail("no key was held: nothing was commanded");
      }
      (void)link.update(5ms);
    }
  }
  const auto reply = link.send(*command, 20s);
  if (!reply || reply->result != bregma_wire_COMMAND_DONE) {
    key.reset(); // the terminal as it was
    return show_reply(reply, context);
  }
  const auto end = motion.follow(reply->id, held);
  key.reset();
  return show_motion(end, context);
}

// To the driver itself, so that nothing in between delays a stop.
int command_arm(wire::CommandKind kind, const std::string &arm, const Context &context) {
  auto command = live::make_command(kind, {arm});
  if (command) {
    (void)wire::set_name(command->receiver, arm); // its length was checked
  }
  return send_and_show(command, context);
}

CLI::App *add_leaf(CLI::App &parent, const char *name, const char *text, ScanArguments &arguments, Context &context) {
  auto *command = parent.add_subcommand(name, text);
  command->add_option("--arm", arguments.arm, "The arm of the case")->capture_default_str();
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  return command;
}

void add_motions(CLI::App &robot, Context &context) {
  const auto arguments = std::make_shared<MoveArguments>();
  auto *move = robot.add_subcommand("move", "Moves the guide onto a planned trajectory while a key is held down");
  move->add_option("trajectory", arguments->trajectory, "Of the case")->required();
  move->add_option("--arm", arguments->arm, "The arm of the case")->capture_default_str();
  move->add_option("--standoff-mm", arguments->standoff_mm, "Of the guide's tip before the entry")
      ->check(CLI::Range(0.0, 500.0))
      ->capture_default_str();
  move->add_option("--speed-mm-s", arguments->speed_mm_s, "Along the path; the driver limits it too")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  move->add_flag("--hold", arguments->hold, "Without a key: the deadman is held while this command runs (scripts)");
  move->footer("The registration must be verified. The daemon plans the path, checks it against head and table, and "
               "refuses with\n"
               "the reason. The arm stops within 150 ms when the key is released, and the stop is latched: `bregma "
               "robot reset`.\n"
               "Only simulated arms are moved.\n\nExamples:\n"
               "  bregma robot move Biopsy\n"
               "  bregma robot move Biopsy --standoff-mm 30 --speed-mm-s 10 --hold --json");
  add_json_flag(*move, context);
  add_daemon_options(*move, context);
  move->callback(
      [arguments, &context] { context.run = [arguments, &context] { return move_guide(*arguments, context); }; });

  struct Verb {
    const char *name, *text;
    wire::CommandKind kind;
  };
  for (const Verb &verb : {Verb{"stop", "Stops the arm; the stop is latched", bregma_wire_COMMAND_STOP_ROBOT},
                           Verb{"hold", "Ends the motion; the arm stays enabled", bregma_wire_COMMAND_HOLD_ROBOT},
                           Verb{"reset", "Ends a latched stop", bregma_wire_COMMAND_RESET_ROBOT}}) {
    auto *command = robot.add_subcommand(verb.name, verb.text);
    command->add_option("--arm", arguments->arm, "The arm")->capture_default_str();
    add_json_flag(*command, context);
    add_daemon_options(*command, context);
    command->callback([arguments, &context, kind = verb.kind] {
      context.run = [arguments, &context, kind] { return command_arm(kind, arguments->arm, context); };
    });
  }
}

} // namespace

void add_robot_command(CLI::App &app, Context &context) {
  auto *robot = app.add_subcommand("robot", "An arm that registers and navigates without a tracker");
  robot->require_subcommand(1);
  robot->footer("Examples:\n  bregma register start\n  bregma robot scan start --sensor Range\n"
                "  bregma robot scan stop\n  bregma register accept\n  bregma robot move Biopsy --standoff-mm 50");
  add_motions(*robot, context);
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

  auto *stop = add_leaf(*scan, "stop", "Stops the scan", *arguments, context);
  stop->callback([arguments, &context] {
    context.run = [arguments, &context] {
      return send_and_show(live::make_command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {arguments->arm}), context);
    };
  });
}

} // namespace bregma::cli
