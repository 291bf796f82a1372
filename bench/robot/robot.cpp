// Robot and its sensors: the figures of docs/robot.md.
#include <cstdio>
#include <exception>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "bench/robot/robot_parts.hpp"

int main(int argc, char **argv) {
  CLI::App app("Arms, sensors and calibrations of a robot");
  bregma::bench::RobotBenchOptions options;
  bregma::bench::add_options(app, options, bregma::bench::kRobotParts);
  app.add_option("--case", options.case_folder, "Case folder whose scalp is the head")->capture_default_str();
  app.add_option("--pictures", options.pictures, "Write the figures of the documentation to this folder");
  CLI11_PARSE(app, argc, argv);
  try {
    bregma::bench::Report report(options.json);
    constexpr std::pair<const char *, void (*)(bregma::bench::Report &, const bregma::bench::RobotBenchOptions &)>
        kParts[] = {
            {"kinematics", bregma::bench::kinematics_figures}, {"calibration", bregma::bench::calibration_figures},
            {"range", bregma::bench::range_figures},           {"scan", bregma::bench::scan_figures},
            {"daemon", bregma::bench::daemon_scan_figures},
        };
    for (const auto &[name, part] : kParts) {
      if (options.wants(name)) {
        part(report, options);
      }
    }
    return report.all_hold() ? 0 : 1;
  } catch (const std::exception &problem) {
    std::fprintf(stderr, "bench_robot: %s\n", problem.what());
    return 2;
  }
}
