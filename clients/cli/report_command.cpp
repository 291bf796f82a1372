// `bregma report`: report on a recorded session.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "base/write_file.hpp"
#include "casefile/run_limits.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/report/html_report.hpp"
#include "clients/cli/report/judgement.hpp"
#include "clients/cli/report/session_analysis.hpp"
#include "clients/cli/report/summary.hpp"

namespace bregma::cli {
namespace {

struct ReportOptions {
  std::vector<std::string> sessions;
  std::string html;
  std::string scenario;
};

int run_report(const ReportOptions &options, const Context &context) {
  std::vector<std::string> inputs = options.sessions;
  inputs.push_back(options.scenario);
  if (auto kept = check_output("--html", options.html, inputs); !kept) {
    return fail(kept.error());
  }
  casefile::RunLimits limits;
  if (!options.scenario.empty()) {
    const auto loaded = casefile::load_run_limits(options.scenario);
    if (!loaded) {
      return fail(loaded.error());
    }
    limits = *loaded;
  }
  const std::vector<std::filesystem::path> files(options.sessions.begin(), options.sessions.end());
  const auto reader = casefile::SessionReader::open(files);
  if (!reader) {
    return fail(reader.error());
  }
  const auto session = report::analyse(*reader);
  if (!session) {
    const std::string &message = session.error().message;
    const bool names_file = std::any_of(options.sessions.begin(), options.sessions.end(), [&](const std::string &file) {
      return message.find(file) != std::string::npos;
    });
    return fail(names_file ? message : options.sessions.front() + ": " + message);
  }
  const auto judgements = report::judge(*session, limits);
  if (!options.html.empty()) {
    const auto page = report::html_report(*session, judgements);
    const auto written = page ? base::write_file(options.html, *page) : tl::unexpected(page.error());
    if (!written) {
      return fail(written.error());
    }
  }
  if (context.json) {
    print_json(report::summary_json(*session, judgements));
  } else {
    print(report::summary_text(*session, judgements));
    if (!options.html.empty()) {
      print("Written: " + options.html + "\n");
    }
  }
  return report::all_hold(judgements) ? kOk : kRefused;
}

} // namespace

void add_report_command(CLI::App &app, Context &context) {
  auto options = std::make_shared<ReportOptions>();
  auto *command = app.add_subcommand("report", "Summarises a recorded session and compares it with limits");
  command
      ->add_option("session", options->sessions,
                   "Session file (.db); all files of one operation if the daemon was restarted in it")
      ->required();
  command->add_option("--html", options->html, "Write a page with plots, in one self-contained file");
  command->add_option("--scenario", options->scenario, "Compare with the [limits] of this scenario file");
  add_json_flag(*command, context);
  command->footer("Exit code 1 when a limit of the scenario was exceeded.\n\nExamples:\n"
                  "  bregma report sessions/2024-05-01T10-20.db --html report.html\n"
                  "  bregma report run.db --scenario biopsy.toml --json\n"
                  "  bregma report sessions/20261129T1020*.db");
  command->callback(
      [options, &context] { context.run = [options, &context] { return run_report(*options, context); }; });
}

} // namespace bregma::cli
