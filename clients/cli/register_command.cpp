// `bregma register`: registration of points in files, and the steps of the daemon's registration.
#include <algorithm>
#include <array>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/command_reply.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/registration/register_commands.hpp"
#include "clients/cli/wire_labels.hpp"

namespace bregma::cli {

namespace {

using nlohmann::json;

struct LiveArguments {
  std::string tool = "Stylus";
  std::string point;
  std::string action; // for trace: start or stop
};

json fiducials_json(const live::Snapshot &snapshot) {
  json out = json::array();
  if (!snapshot.fiducials) {
    return out;
  }
  const auto &report = *snapshot.fiducials;
  for (std::size_t i = 0; i < std::min<std::size_t>(report.count, std::size(report.fiducials)); ++i) {
    const wire::FiducialResidual &f = report.fiducials[i];
    out.push_back({{"fiducial", wire::text(f.fiducial)},
                   {"residual_mm", json_number(f.norm_mm)},
                   {"leave_one_out_mm", json_number(f.leave_one_out_mm)},
                   {"p_value", json_number(f.p_value)},
                   {"suspect", f.suspect}});
  }
  return out;
}

std::string fiducials_text(const live::Snapshot &snapshot) {
  Table table({"Fiducial", "Residual mm", "Left out mm", "p", ""});
  for (const json &f : fiducials_json(snapshot)) {
    const auto figure = [&f](const char *key, int decimals) {
      return f[key].is_null() ? std::string("-") : fixed(f[key].get<double>(), decimals);
    };
    table.row({printable(f["fiducial"].get<std::string>()), figure("residual_mm", 2), figure("leave_one_out_mm", 2),
               figure("p_value", 3), f["suspect"].get<bool>() ? "suspect" : ""});
  }
  return table.empty() ? "" : "\n" + table.text();
}

int show_status(const Context &context) {
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  if (auto there = link.wait_for_daemon(); !there) {
    return fail(there.error());
  }
  link.settle();
  const live::Snapshot &snapshot = link.snapshot();
  if (!snapshot.registration) {
    return fail("the daemon has sent no registration");
  }
  const wire::RegistrationState &r = *snapshot.registration;
  if (context.json) {
    print_json({{"status", registration_label(r.status)},
                {"reason", refusal_label(r.reason)},
                {"subject", wire::text(r.subject)},
                {"text", r.text},
                {"revision", r.revision},
                {"accepted_revision", r.accepted_revision},
                {"fiducial_count", r.fiducial_count},
                {"surface_count", r.surface_count},
                {"fre_mm", json_number(r.fre_mm)},
                {"surface_rms_mm", json_number(r.surface_rms_mm)},
                {"fiducials", fiducials_json(snapshot)}});
    return kOk;
  }
  print("Registration " + std::string(registration_label(r.status)) +
        (*r.text == '\0' ? "" : ": " + printable(r.text)) + "\n" + std::to_string(r.fiducial_count) + " fiducials, " +
        std::to_string(r.surface_count) + " surface points, FRE " + fixed(r.fre_mm, 2, "mm") + ", surface RMS " +
        fixed(r.surface_rms_mm, 2, "mm") + "\n" + fiducials_text(snapshot));
  return kOk;
}

CLI::App *add_live(CLI::App &parent, const char *name, const char *text, Context &context) {
  auto *command = parent.add_subcommand(name, text);
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  return command;
}

// The command is built when it runs, because its arguments are known only then.
template <class MakeBody> void on_run(CLI::App *command, Context &context, MakeBody make_body) {
  command->callback(
      [make_body, &context] { context.run = [make_body, &context] { return send_and_show(make_body(), context); }; });
}

void add_tool_option(CLI::App &command, LiveArguments &arguments) {
  command.add_option("--tool", arguments.tool, "The calibrated tool that touches")->capture_default_str();
}

void add_touch_commands(CLI::App &parent, Context &context) {
  const auto arguments = std::make_shared<LiveArguments>();
  auto *capture = add_live(parent, "capture", "Captures the touch of a fiducial: hold the tip still on it", context);
  capture->add_option("fiducial", arguments->point, "Its name in the case")->required();
  add_tool_option(*capture, *arguments);
  on_run(capture, context, [arguments] {
    return live::make_command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, {arguments->tool, arguments->point});
  });

  auto *remove = add_live(parent, "remove", "Removes the touch of a fiducial", context);
  remove->add_option("fiducial", arguments->point, "Its name in the case")->required();
  on_run(remove, context,
         [arguments] { return live::make_command(bregma_wire_COMMAND_REMOVE_FIDUCIAL, {arguments->point}); });

  auto *trace = add_live(parent, "trace", "Starts or stops tracing the skin", context);
  trace->add_option("action", arguments->action, "start or stop")->required()->check(CLI::IsMember({"start", "stop"}));
  add_tool_option(*trace, *arguments);
  on_run(trace, context, [arguments] {
    return live::make_command(arguments->action == "start" ? bregma_wire_COMMAND_START_TRACE
                                                           : bregma_wire_COMMAND_STOP_TRACE,
                              {arguments->tool});
  });

  auto *check = add_live(parent, "check", "Checks a landmark: distance of the shown tip from it", context);
  check->add_option("landmark", arguments->point, "Its name in the case")->required();
  add_tool_option(*check, *arguments);
  on_run(check, context, [arguments] {
    return live::make_command(bregma_wire_COMMAND_CHECK_TOUCH, {arguments->tool, arguments->point});
  });
}

} // namespace

void add_register_command(CLI::App &app, Context &context) {
  auto *command = app.add_subcommand("register", "Registers the patient, or data in files");
  command->require_subcommand(1);
  command->footer("Examples:\n  bregma register start\n  bregma register capture Nasion\n"
                  "  bregma register trace start    (move over the skin, then)\n  bregma register trace stop\n"
                  "  bregma register status\n  bregma register accept\n  bregma register check Bregma\n"
                  "  bregma register confirm\n  bregma register points touched.csv fiducials.mrk.json\n"
                  "  bregma register surface trace.csv scalp.ply\n"
                  "  bregma register scan scan.txt scalp.ply --curve curve.json");
  auto *status = add_live(*command, "status", "The current estimate, and the residual of each fiducial", context);
  status->callback([&context] { context.run = [&context] { return show_status(context); }; });

  auto *start = add_live(*command, "start", "Starts a registration; an earlier one is discarded", context);
  on_run(start, context, [] { return live::make_command(bregma_wire_COMMAND_START_REGISTRATION); });
  add_touch_commands(*command, context);
  auto *accept = add_live(*command, "accept", "Accepts the current estimate", context);
  on_run(accept, context, [] { return live::make_command(bregma_wire_COMMAND_ACCEPT_REGISTRATION); });
  auto *confirm = add_live(*command, "confirm", "Confirms the verification: navigation may start", context);
  on_run(confirm, context, [] { return live::make_command(bregma_wire_COMMAND_CONFIRM_VERIFICATION); });
  add_register_points(*command, context);
  add_register_surface(*command, context);
  add_register_scan(*command, context);
  add_register_cloud(*command, context);
  add_register_curves(*command, context);
}

} // namespace bregma::cli
