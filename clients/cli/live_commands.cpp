// `bregma status | watch | alarms | target`: state of a running daemon, and commands to it.
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/uncertainty/tre.hpp"
#include "casefile/case.hpp"
#include "clients/cli/command_reply.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/live_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/watch_command.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/names.hpp"

namespace bregma::cli {
namespace {

using nlohmann::json;

// The tip of a tool in the coordinates of an image of the case, as a workstation shows that image.
struct TipInImage {
  std::string tool, image;
  Eigen::Vector3d tip_mm;
  double rms_mm; // of the tip now, and of the registration of the image
};

std::vector<TipInImage> tips_in_images(const live::Snapshot &snapshot, const casefile::Case &c, const live::Now &now) {
  std::vector<TipInImage> out;
  const DaemonView daemon = view_daemon(snapshot, now);
  for (const auto &[name, state] : snapshot.tools) {
    const ToolView view = view_tool(state, daemon, now);
    if (!view.fresh) {
      continue;
    }
    const Eigen::Vector3d tip = Eigen::Vector3d::Map(view.tip_mm);
    for (const casefile::RegisteredImage &image : c.images) {
      const auto &T_image_source = image.T_image_source;
      const double image_rms_mm = uncertainty::rms_mm(uncertainty::tre_covariance(T_image_source.covariance, tip));
      out.push_back({name, image.name, T_image_source.pose.inverse() * tip, std::hypot(view.tre_rms_mm, image_rms_mm)});
    }
  }
  return out;
}

// Prints the state with the tips in each image of the loaded case.
int status_with_images(const live::Snapshot &snapshot, const Context &context, const live::Now &now) {
  const std::string folder = snapshot.health->case_folder;
  if (folder.empty()) {
    return fail("no case is loaded: there are no images");
  }
  const auto loaded = casefile::load_case(folder, casefile::Checksums::kIgnore);
  if (!loaded) {
    return fail(loaded.error());
  }
  Table table({"Tool", "Image", "Tip R A S mm", "RMS mm"});
  json tips = json::array();
  for (const TipInImage &tip : tips_in_images(snapshot, *loaded, now)) {
    table.row({printable(tip.tool), printable(tip.image), vector_text(tip.tip_mm, 1), fixed(tip.rms_mm, 2)});
    tips.push_back({{"tool", tip.tool},
                    {"image", tip.image},
                    {"tip_mm", json_vector(tip.tip_mm)},
                    {"rms_mm", json_number(tip.rms_mm)}});
  }
  if (context.json) {
    json out = status_json(snapshot, context.domain, now);
    out["tips_in_images"] = std::move(tips);
    print_json(out);
  } else {
    print(status_text(snapshot, context.domain, now) + "\n" +
          (table.empty() ? "Tips in other images  none: the case has no other image, or no pose is shown\n"
                         : table.text()));
  }
  return kOk;
}

int status(bool images, const Context &context) {
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  const auto there = link.wait_for_daemon();
  if (!there && !link.snapshot().health) {
    return fail(there.error());
  }
  link.settle();
  const live::Now now = live::Now::read();
  if (images && live::alive(link.snapshot(), now.boot_ns)) {
    return status_with_images(link.snapshot(), context, now);
  }
  if (context.json) {
    print_json(status_json(link.snapshot(), context.domain, now));
  } else {
    print(status_text(link.snapshot(), context.domain, now));
  }
  return live::alive(link.snapshot(), now.boot_ns) ? kOk : kBadInput;
}

int list_alarms(const Context &context) {
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  if (auto there = link.wait_for_daemon(); !there) {
    return fail(there.error());
  }
  link.settle();
  const auto alarms = standing_alarms(link.snapshot());
  if (context.json) {
    json out = json::array();
    for (const auto &alarm : alarms) {
      out.push_back(alarm_json(alarm));
    }
    print_json(out);
    return kOk;
  }
  for (const auto &alarm : alarms) {
    print(alarm_line(alarm, live::daemon_now_ns(link.snapshot(), live::Now::read().boot_ns)) + "\n");
  }
  if (alarms.empty()) {
    print("no alarms\n");
  }
  return kOk;
}

const wire::TargetAccuracy *accuracy_of(const live::Snapshot &snapshot, const std::string &target) {
  if (snapshot.accuracy) {
    const auto &accuracy = *snapshot.accuracy;
    for (std::size_t i = 0; i < std::min<std::size_t>(accuracy.target_count, std::size(accuracy.targets)); ++i) {
      if (wire::view(accuracy.targets[i].target) == target) {
        return &accuracy.targets[i];
      }
    }
  }
  return nullptr;
}

int list_targets(const Context &context) {
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  if (auto there = link.wait_for_daemon(); !there) {
    return fail(there.error());
  }
  link.settle();
  const std::string folder = link.snapshot().health->case_folder;
  if (folder.empty()) {
    return fail("no case is loaded: there are no targets");
  }
  const auto loaded = casefile::load_case(folder);
  if (!loaded) {
    return fail(loaded.error());
  }
  json targets = json::array();
  Table target_table({"Target", "R mm", "A mm", "S mm", "TRE RMS mm", "TRE 95 % mm", "Of it from image mm"});
  for (const auto &target : loaded->targets) {
    const auto *accuracy = accuracy_of(link.snapshot(), target.name);
    const double rms = accuracy != nullptr ? accuracy->tre_rms_mm : wire::kUnknown;
    const double bound = accuracy != nullptr ? accuracy->tre_95.semi_axes_mm[0] : wire::kUnknown;
    const double image_rms = std::sqrt(target.placing_covariance_mm2.trace());
    const auto &p = target.position_mm;
    target_table.row({printable(target.name), fixed(p.x(), 1), fixed(p.y(), 1), fixed(p.z(), 1), fixed(rms, 2),
                      fixed(bound, 2),
                      target.placed_in.empty() ? "-" : printable(target.placed_in) + " " + fixed(image_rms, 2)});
    targets.push_back({{"target", target.name},
                       {"position_mm", json_vector(p)},
                       {"tre_rms_mm", json_number(rms)},
                       {"tre_95_mm", json_number(bound)},
                       {"planned_in", target.placed_in},
                       {"image_rms_mm", json_number(image_rms)}});
  }
  json trajectories = json::array();
  Table trajectory_table({"Trajectory", "Entry R A S mm", "Target R A S mm", "Length mm"});
  for (const auto &trajectory : loaded->trajectories) {
    const double length = (trajectory.target_mm - trajectory.entry_mm).norm();
    trajectory_table.row({printable(trajectory.name), vector_text(trajectory.entry_mm, 1),
                          vector_text(trajectory.target_mm, 1), fixed(length, 1)});
    trajectories.push_back({{"trajectory", trajectory.name},
                            {"entry_mm", json_vector(trajectory.entry_mm)},
                            {"target_mm", json_vector(trajectory.target_mm)},
                            {"length_mm", length}});
  }
  if (context.json) {
    print_json({{"case_folder", folder}, {"targets", targets}, {"trajectories", trajectories}});
    return kOk;
  }
  print(target_table.text() + "\n" + trajectory_table.text());
  print("\nTRE is predicted for the accepted registration; \"-\" until there is one.\n");
  return kOk;
}

void add_status_command(CLI::App &app, Context &context) {
  auto *command = app.add_subcommand("status", "Prints the state of daemon, registration, devices and loops once");
  auto images = std::make_shared<bool>(false);
  command->add_flag("--images", *images, "Also the tips in the coordinates of each registered image of the case");
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  command->footer("Exit code 2 when no daemon answers.\n\nExamples:\n  bregma status\n  bregma status --images\n"
                  "  bregma status --json | jq .devices");
  command->callback([images, &context] { context.run = [images, &context] { return status(*images, context); }; });
}

void add_alarms_command(CLI::App &app, Context &context) {
  auto *alarms = app.add_subcommand("alarms", "Lists active alarms and acknowledges them");
  alarms->require_subcommand(0, 1);
  add_json_flag(*alarms, context);
  add_daemon_options(*alarms, context);
  alarms->footer("Examples:\n  bregma alarms\n  bregma alarms ack drift\n  bregma alarms ack tool_hidden Probe");
  // Runs after the subcommand's own callback and must not replace it.
  alarms->callback([alarms, &context] {
    if (alarms->get_subcommands().empty()) {
      context.run = [&context] { return list_alarms(context); };
    }
  });

  auto *list = alarms->add_subcommand("list", "Alarms that are raised or acknowledged");
  add_json_flag(*list, context);
  add_daemon_options(*list, context);
  list->callback([&context] { context.run = [&context] { return list_alarms(context); }; });

  auto *acknowledge = alarms->add_subcommand("ack", "Acknowledges an alarm");
  auto name = std::make_shared<std::pair<std::string, std::string>>();
  acknowledge->add_option("kind", name->first, "As listed, for example drift")->required();
  acknowledge->add_option("subject", name->second, "The device, tool or target of the alarm");
  add_json_flag(*acknowledge, context);
  add_daemon_options(*acknowledge, context);
  acknowledge->callback([name, &context] {
    context.run = [name, &context] {
      return send_and_show(live::make_command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {name->first, name->second}),
                           context);
    };
  });
}

void add_target_command(CLI::App &app, Context &context) {
  auto *target = app.add_subcommand("target", "Targets of the loaded case, and navigation to them");
  target->require_subcommand(1);
  target->footer("Examples:\n  bregma target list\n  bregma target navigate Probe Biopsy\n  bregma target stop");

  auto *list = target->add_subcommand("list", "Targets with predicted error, and trajectories");
  add_json_flag(*list, context);
  add_daemon_options(*list, context);
  list->callback([&context] { context.run = [&context] { return list_targets(context); }; });

  auto *navigate = target->add_subcommand("navigate", "Navigates a tool along a trajectory")->alias("select");
  auto plan = std::make_shared<std::pair<std::string, std::string>>();
  navigate->add_option("tool", plan->first, "A calibrated tool, for example Probe")->required();
  navigate->add_option("trajectory", plan->second, "A trajectory of the case")->required();
  add_json_flag(*navigate, context);
  add_daemon_options(*navigate, context);
  navigate->callback([plan, &context] {
    context.run = [plan, &context] {
      return send_and_show(live::make_command(bregma_wire_COMMAND_START_NAVIGATION, {plan->first, plan->second}),
                           context);
    };
  });

  auto *stop = target->add_subcommand("stop", "Stops navigation");
  add_json_flag(*stop, context);
  add_daemon_options(*stop, context);
  stop->callback([&context] {
    context.run = [&context] {
      return send_and_show(live::make_command(bregma_wire_COMMAND_STOP_NAVIGATION), context);
    };
  });
}

} // namespace

void add_live_commands(CLI::App &app, Context &context) {
  add_status_command(app, context);
  add_watch_command(app, context);
  add_alarms_command(app, context);
  add_target_command(app, context);
}

} // namespace bregma::cli
