#include "clients/cli/robot_motions.hpp"

#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/geometry/rigid3.hpp"
#include "clients/cli/command_reply.hpp"
#include "clients/cli/held_key.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"

namespace bregma::cli {

namespace {

struct MoveArguments {
  std::string arm = "Robot";
  std::string trajectory;
  double standoff_mm = 50.0;
  double speed_mm_s = 20.0;
  bool hold = false; // the deadman, without a key
};

struct RasterArguments {
  std::string arm = "Robot";
  std::string sensor = "Range";
  double width_mm = 100.0, height_mm = 110.0, line_mm = 8.0;
  double speed_mm_s = 50.0;
  bool hold = false;
};

int lines_of(const RasterArguments &arguments) {
  return static_cast<int>(std::floor(arguments.width_mm / arguments.line_mm)) + 1;
}

using Flange = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::RobotFlange>;

using namespace std::chrono_literals;

constexpr std::int64_t kDeadmanPeriod_ns = 50'000'000;
constexpr std::int64_t kDriverSilent_ns = 1'000'000'000;
constexpr std::int64_t kKeyWait_ns = 30'000'000'000;
constexpr std::int64_t kStateWait_ns = 3'000'000'000; // for the pose and the driver of an arm
constexpr auto kReplyWait = 20s;

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

// Commands a motion by send(link) and holds the deadman until the motion has ended: while a key is held down, or
// without a key as long as this program runs.
template <class Send> int carry_out(const std::string &arm, bool hold, const Context &context, Send &&send) {
  if (!hold && !HeldKey::available()) {
    return fail("the deadman is a key that is held down: standard input is no terminal (--hold: without a key)");
  }
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kCommands, context.wait_s);
  Motion motion(link, arm);
  std::optional<HeldKey> key;
  const auto held = [&](std::int64_t now_ns) { return !key || key->held(now_ns); };
  if (!hold) {
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
  const auto reply = send(link);
  if (!reply || reply->result != bregma_wire_COMMAND_DONE) {
    key.reset(); // the terminal as it was
    return show_reply(reply, context);
  }
  const auto end = motion.follow(reply->id, held);
  key.reset();
  return show_motion(end, context);
}

int move_guide(const MoveArguments &arguments, const Context &context) {
  const auto command = live::make_command(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY,
                                          {arguments.arm, arguments.trajectory, std::to_string(arguments.standoff_mm),
                                           std::to_string(arguments.speed_mm_s)});
  if (!command) {
    return fail(command.error());
  }
  return carry_out(arguments.arm, arguments.hold, context,
                   [&](live::DaemonLink &link) { return link.send(*command, kReplyWait); });
}

// Lines along the flange's y, there and back, about where it is.
wire::RobotPath raster_about(const Flange &here, const RasterArguments &arguments) {
  wire::RobotPath out{};
  const int lines = lines_of(arguments);
  const double first_mm = -0.5 * (lines - 1) * arguments.line_mm;
  for (int line = 0; line < lines; ++line) {
    const double side = line % 2 == 0 ? -0.5 : 0.5;
    for (const double y_mm : {side * arguments.height_mm, -side * arguments.height_mm}) {
      const geometry::Vector3d offset(first_mm + line * arguments.line_mm, y_mm, 0.0);
      out.T_base_flange[out.waypoint_count++] =
          wire::to_wire(Flange(here.rotation(), geometry::Vector3d(here.translation() + here.rotation() * offset)));
    }
  }
  return out;
}

// Where the arm is; nullopt: its driver does not say.
std::optional<Flange> present_flange(live::DaemonLink &link, const std::string &arm) {
  dds::Reader<wire::RobotState> states(link.participant());
  std::optional<Flange> out;
  for (const auto end_ns = live::Now::read().boot_ns + kStateWait_ns; !out && live::Now::read().boot_ns < end_ns;) {
    (void)link.update(20ms);
    states.take_each([&](const wire::RobotState &state, const dds::SampleInfo & /*info*/) {
      const Eigen::Map<const geometry::Vector3d> at(state.T_base_flange.translation_mm);
      const Eigen::Map<const Eigen::Vector4d> turn(state.T_base_flange.rotation_wxyz);
      if (wire::view(state.device) == arm && at.allFinite() && std::abs(turn.norm() - 1.0) < 1e-3) {
        out = wire::from_wire<geometry::frame::RobotBase, geometry::frame::RobotFlange>(state.T_base_flange);
      }
    });
  }
  return out;
}

int move_scan(const RasterArguments &arguments, const Context &context) {
  if (2 * lines_of(arguments) > static_cast<int>(bregma_wire_MAX_WAYPOINTS)) {
    return fail("--line-mm: " + std::to_string(lines_of(arguments)) + " lines, at most " +
                std::to_string(bregma_wire_MAX_WAYPOINTS / 2) + " are possible");
  }
  auto command = live::make_command(
      bregma_wire_COMMAND_START_SURFACE_SCAN,
      {arguments.arm, arguments.sensor, std::to_string(arguments.speed_mm_s), std::to_string(arguments.line_mm)});
  if (!command) {
    return fail(command.error());
  }
  (void)wire::set_name(command->receiver, arguments.arm); // its length was checked
  return carry_out(arguments.arm, arguments.hold, context,
                   [&](live::DaemonLink &link) -> base::Result<wire::CommandReply> {
                     const auto here = present_flange(link, arguments.arm);
                     if (!here) {
                       return base::failure("no pose of \"" + arguments.arm + "\" on domain " +
                                            std::to_string(context.domain) + ": is its driver running?");
                     }
                     wire::RobotPath path = raster_about(*here, arguments);
                     (void)wire::set_name(path.device, arguments.arm);
                     (void)wire::set_name(path.client, link.client());
                     path.speed_mm_s = arguments.speed_mm_s;
                     const dds::Writer<wire::RobotPath> paths(link.participant());
                     for (const auto end_ns = live::Now::read().boot_ns + kStateWait_ns;
                          paths.matched_readers() == 0 && live::Now::read().boot_ns < end_ns;) {
                       (void)link.update(20ms);
                     }
                     return link.send(*command, kReplyWait, [&](std::uint64_t id) {
                       path.motion_id = id;
                       path.sent_time_ns = live::Now::read().utc_ns;
                       (void)paths.write(path); // one that is lost: the driver says that it waits
                     });
                   });
}

// To the driver itself, so that nothing in between delays a stop.
int command_arm(wire::CommandKind kind, const std::string &arm, const Context &context) {
  auto command = live::make_command(kind, {arm});
  if (command) {
    (void)wire::set_name(command->receiver, arm); // its length was checked
  }
  return send_and_show(command, context);
}

} // namespace

void add_robot_motions(CLI::App &robot, Context &context) {
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

void add_scan_motion(CLI::App &scan, Context &context) {
  const auto arguments = std::make_shared<RasterArguments>();
  auto *move = scan.add_subcommand("move", "Moves the sensor over the skin in a raster while a key is held down");
  move->add_option("--arm", arguments->arm, "The arm of the case")->capture_default_str();
  move->add_option("--sensor", arguments->sensor, "The range sensor that it carries")->capture_default_str();
  move->add_option("--width-mm", arguments->width_mm, "Of the raster, along the flange's x")
      ->check(CLI::Range(1.0, 1000.0))
      ->capture_default_str();
  move->add_option("--height-mm", arguments->height_mm, "Of the raster, along the flange's y")
      ->check(CLI::Range(1.0, 1000.0))
      ->capture_default_str();
  move->add_option("--line-mm", arguments->line_mm, "Between the lines")
      ->check(CLI::Range(0.5, 500.0))
      ->capture_default_str();
  move->add_option("--speed-mm-s", arguments->speed_mm_s, "Along the lines; the driver limits it too")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  move->add_flag("--hold", arguments->hold, "Without a key: the deadman is held while this command runs (scripts)");
  move->footer("The raster lies about the place where the flange is now, at its height and in its orientation: before "
               "the head is\n"
               "registered nobody knows where it is, so look at the height first. `bregma arm scan` checks reach and "
               "distances.\n"
               "The arm stops within 150 ms when the key is released, and the stop is latched: `bregma robot reset`.\n"
               "Only simulated arms are moved.\n\nExamples:\n"
               "  bregma robot scan start\n  bregma robot scan move --width-mm 100 --height-mm 110 --line-mm 6\n"
               "  bregma robot scan stop");
  add_json_flag(*move, context);
  add_daemon_options(*move, context);
  move->callback(
      [arguments, &context] { context.run = [arguments, &context] { return move_scan(*arguments, context); }; });
}

} // namespace bregma::cli
