// Robot and its sensors: the figures of docs/robot.md.
#include <cstdio>
#include <exception>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "bench/robot/robot_parts.hpp"

int main(int argc, char **argv) {
  CLI::App app("Arms, sensors and calibrations of a robot");
  bregma::bench::RobotBenchOptions options;
  bregma::bench::add_options(app, options, bregma::bench::kRobotParts);
  app.add_option("--pictures", options.pictures, "Write the figures of the documentation to this folder");
  CLI11_PARSE(app, argc, argv);
  try {
    bregma::bench::Report report(options.json);
    if (options.wants("kinematics")) {
      bregma::bench::kinematics_figures(report, options);
    }
    return report.all_hold() ? 0 : 1;
  } catch (const std::exception &problem) {
    std::fprintf(stderr, "bench_robot: %s\n", problem.what());
    return 2;
  }
}
