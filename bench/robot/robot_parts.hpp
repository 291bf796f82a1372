// The parts of bench_robot, one source each.
#pragma once

#include <string>
#include <vector>

#include "bench/record.hpp"

namespace bregma::bench {

struct RobotBenchOptions : Options {
  std::string case_folder = "out/cases/colin27"; // its scalp is the head
  std::string pictures;                          // folder for figures; none when empty
};
inline const std::vector<std::string> kRobotParts{"kinematics", "calibration", "range", "scan", "daemon"};

inline constexpr unsigned kRobotSeed = 20261129;

void kinematics_figures(Report &report, const RobotBenchOptions &options);
void calibration_figures(Report &report, const RobotBenchOptions &options);
void range_figures(Report &report, const RobotBenchOptions &options);
void scan_figures(Report &report, const RobotBenchOptions &options);
void daemon_scan_figures(Report &report, const RobotBenchOptions &options);

} // namespace bregma::bench
