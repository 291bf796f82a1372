// `bregma mri report`: follows a registration of a scanner, and makes a page of what was received.
#include "clients/cli/mri/report/report_command.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>
#include <nlohmann/json.hpp>

#include "base/read_file.hpp"
#include "base/write_file.hpp"
#include "casefile/coil_frames.hpp"
#include "clients/cli/mri/control_points.hpp"
#include "clients/cli/mri/report/run_page.hpp"
#include "clients/cli/mri/scanner_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/dds.hpp"

namespace bregma::cli {

namespace {

using namespace std::chrono_literals;

constexpr auto kReportLook = 5ms;
constexpr auto kQuiet = 2s; // without a corrected slice: the series has ended
constexpr int kKeptSlices = 256;

volatile std::sig_atomic_t report_interrupted = 0;

// The first signal ends the following, and the page is made of what came; the second ends the program.
void interrupt_report(int signal) {
  report_interrupted = 1;
  std::signal(signal, SIG_DFL);
}

struct ReportArguments {
  std::string html, frame, phantom, truth;
  double cell_mm = mri_report::RunInputs().cell_mm, bar_mm = mri_report::RunInputs().bar_mm;
  std::array<double, 3> target_mm{};
  int slices = 1;
};

// The true pose of the base, as `bregma-sim-scanner` writes it.
base::Result<geometry::Rigid3<mri::frame::Device, mri::frame::Base>> read_truth(const std::string &file) {
  const auto text = base::read_file(file);
  if (!text) {
    return tl::unexpected(text.error());
  }
  const auto json = nlohmann::json::parse(*text, nullptr, false);
  Eigen::Matrix4d T;
  try {
    for (std::size_t r = 0; r < 4; ++r) {
      for (std::size_t c = 0; c < 4; ++c) {
        T(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) =
            json.at("T_device_base").at(r).at(c).get<double>();
      }
    }
  } catch (const nlohmann::json::exception &) {
    return base::failure(file + ": T_device_base, a matrix of 4 x 4, is missing");
  }
  const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
  if (!T.allFinite() || !(R * R.transpose()).isIdentity(1e-6) || R.determinant() < 0.0) {
    return base::failure(file + ": T_device_base is not a rigid motion");
  }
  return geometry::Rigid3<mri::frame::Device, mri::frame::Base>(R, T.topRightCorner<3, 1>());
}

base::Result<mri_report::RunInputs> read_inputs(const ReportArguments &arguments) {
  mri_report::RunInputs out;
  if (!arguments.frame.empty()) {
    auto frame = casefile::read_coil_frame(arguments.frame);
    if (!frame) {
      return tl::unexpected(frame.error());
    }
    out.frame = std::move(*frame);
  }
  if (!arguments.phantom.empty()) {
    std::vector<std::string> notes;
    auto points = read_control_points(arguments.phantom, notes);
    print_notes(notes);
    if (!points) {
      return tl::unexpected(points.error());
    }
    out.phantom_mm = std::move(*points);
  }
  if (!arguments.truth.empty()) {
    const auto truth = read_truth(arguments.truth);
    if (!truth) {
      return tl::unexpected(truth.error());
    }
    out.T_device_base = *truth;
  }
  out.cell_mm = arguments.cell_mm;
  out.bar_mm = arguments.bar_mm;
  out.target_mm = Eigen::Vector3d::Map(arguments.target_mm.data());
  return out;
}

// Collects until the daemon has corrected so many slices and no more come, the daemon ends, or the user interrupts.
base::Result<mri_report::RunRecord> follow(const ReportArguments &arguments, const Context &context) {
  mri_report::RunRecord record;
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  dds::Reader<wire::ImageSlice> slices(link.participant());
  dds::Reader<wire::ScannerRegistration> states(link.participant());
  wire::Qos all = wire::Topic<wire::CorrectedSlice>::kQos;
  all.depth = kKeptSlices; // not the newest alone
  dds::Reader<wire::CorrectedSlice> corrected(link.participant(), all);
  dds::Reader<wire::RobotTool> tools(link.participant());
  if (auto there = link.wait_for_daemon(); !there) {
    return tl::unexpected(there.error());
  }
  std::string last;
  auto newest = std::chrono::steady_clock::now();
  while (report_interrupted == 0) {
    (void)link.update(0ns);
    slices.take_each([&](const wire::ImageSlice &s, const auto &) { record.add(s); });
    states.take_each([&](const wire::ScannerRegistration &s, const auto &) { record.add(s); });
    corrected.take_each([&](const wire::CorrectedSlice &s, const auto &) {
      record.add(s);
      newest = std::chrono::steady_clock::now();
    });
    tools.take_each([&](const wire::RobotTool &s, const auto &) { record.add(s); });
    const auto &state = record.state();
    if (state && !record.moments().empty()) {
      const std::string line = std::string(scanner_step_label(state->step)) + ", " +
                               std::string(scanner_activity_label(state->activity)) + ": " +
                               record.moments().back().text;
      if (line != last && !context.json) {
        print(line + "\n");
        std::fflush(stdout);
      }
      last = line;
    }
    if ((state && state->step == bregma_wire_SCANNER_STEP_DONE &&
         state->slices_corrected >= static_cast<std::uint64_t>(arguments.slices) &&
         std::chrono::steady_clock::now() - newest > kQuiet) ||
        !live::alive(link.snapshot(), live::Now::read().boot_ns)) {
      break;
    }
    std::this_thread::sleep_for(kReportLook);
  }
  return record;
}

int run_mri_report(const ReportArguments &arguments, const Context &context) {
  if (auto free = check_output("--html", arguments.html, {arguments.frame, arguments.phantom, arguments.truth});
      !free) {
    return fail(free.error());
  }
  const auto inputs = read_inputs(arguments);
  if (!inputs) {
    return fail(inputs.error());
  }
  std::signal(SIGINT, interrupt_report);
  std::signal(SIGTERM, interrupt_report);
  const auto record = follow(arguments, context);
  if (!record) {
    return fail(record.error());
  }
  const mri_report::RunAnalysis analysis = mri_report::analyse(*record, *inputs);
  const auto judgements = mri_report::judge(*record, *inputs, analysis);
  if (!arguments.html.empty()) {
    const auto page = mri_report::html_page(*record, analysis, judgements);
    const auto written = page ? base::write_file(arguments.html, *page) : tl::unexpected(page.error());
    if (!written) {
      return fail(written.error());
    }
  }
  if (context.json) {
    print_json(mri_report::summary_json(*record, analysis, judgements));
  } else {
    print("\n" + mri_report::summary_text(*record, analysis, judgements));
    print(arguments.html.empty() ? "" : "Written: " + arguments.html + "\n");
  }
  return report::all_hold(judgements) ? kOk : kRefused;
}

} // namespace

void add_mri_report(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("report", "Follows a registration of a scanner, and makes a page of it");
  auto arguments = std::make_shared<ReportArguments>();
  command->add_option("--html", arguments->html, "The page, in one self-contained file");
  command->add_option("--frame", arguments->frame, "File of the registration frame (TOML)");
  command->add_option("--phantom", arguments->phantom, "Control points of the phantom in CT (.mrk.json)");
  command->add_option("--cell-mm", arguments->cell_mm, "Distance of neighbouring bars")
      ->check(CLI::Range(2.0, 200.0))
      ->capture_default_str();
  command->add_option("--bar-mm", arguments->bar_mm, "Width of a bar")
      ->check(CLI::Range(0.2, 50.0))
      ->capture_default_str();
  command->add_option("--target-mm", arguments->target_mm, "The target in the robot's base")->capture_default_str();
  command->add_option("--truth", arguments->truth, "Truth of a simulated scanner (truth.json)");
  command
      ->add_option("--slices", arguments->slices, "End when the daemon has corrected this many slices and no more come")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  command->footer("Start it before the registration: it shows what it received. Ctrl-C ends it, and makes the page.\n"
                  "The exit code is 1 where a check of the page fails.\n\nExample:\n"
                  "  bregma mri report --phantom ct.mrk.json --html scanner.html --slices 20");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_mri_report(*arguments, context); }; });
}

} // namespace bregma::cli
