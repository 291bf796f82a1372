#include "clients/cli/case/load_command.hpp"

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/command_reply.hpp"

namespace bregma::cli {

namespace {

constexpr std::chrono::seconds kLoading{60}; // the daemon answers after it has read the surfaces and built their trees

} // namespace

void add_load_commands(CLI::App &group, Context &context) {
  auto folder = std::make_shared<std::string>();
  auto *load = group.add_subcommand("load", "Asks the daemon to load a case");
  load->add_option("folder", *folder, "Case folder, as seen by the daemon's machine")->required();
  add_json_flag(*load, context);
  add_daemon_options(*load, context);
  load->footer("Example:\n  bregma case load colin27");
  load->callback([folder, &context] {
    context.run = [folder, &context] {
      const auto absolute = std::filesystem::absolute(*folder).lexically_normal();
      return send_and_show(live::make_command(bregma_wire_COMMAND_LOAD_CASE, {absolute.string()}), context, kLoading);
    };
  });

  auto *close = group.add_subcommand("close", "Asks the daemon to close its case, and the session with it");
  add_json_flag(*close, context);
  add_daemon_options(*close, context);
  close->footer("Example:\n  bregma case close");
  close->callback([&context] {
    context.run = [&context] { return send_and_show(live::make_command(bregma_wire_COMMAND_CLOSE_CASE), context); };
  });
}

} // namespace bregma::cli
