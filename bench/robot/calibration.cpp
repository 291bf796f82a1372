// Hand-eye and beam calibration on simulated devices: how often the truth lies within the 95 % region.
#include <string>

#include "algorithms/geometry/angles.hpp"
#include "bench/robot/calibration_scenes.hpp"
#include "bench/robot/robot_parts.hpp"

namespace bregma::bench {

namespace {

void add_coverage(Report &report, const std::string &name, const Coverage &c, bool quick) {
  // The region of 1,000 runs; fewer runs scatter more.
  report.add(at_least(name + ".within", c.percent_within, "% of runs", quick ? 88.0 : 93.0));
  report.add(at_most(name + ".within.max", c.percent_within, "% of runs", quick ? 100.0 : 97.0));
  report.add(at_most(name + ".refused", c.refused, "runs", 0.0));
  report.add(figure(name + ".position.rms", c.rms_position_mm, "mm"));
  report.add(figure(name + ".rotation.rms", c.rms_rotation_rad / geometry::kRadiansPerDegree, "deg"));
}

} // namespace

void calibration_figures(Report &report, const RobotBenchOptions &options) {
  const int runs = options.quick ? 100 : 1000;
  report.note("hand-eye: " + std::to_string(runs) +
              " runs of 20 poses, robot 0.05 mm and 0.01 deg, tracker 0.15 mm and "
              "0.1 deg per coordinate; seed " +
              std::to_string(kRobotSeed));
  const HandEyeScene hand_eye;
  add_coverage(report, "robot.hand_eye.ax_yb", hand_eye_coverage(hand_eye, true, 20, runs, kRobotSeed), options.quick);
  add_coverage(report, "robot.hand_eye.ax_xb", hand_eye_coverage(hand_eye, false, 20, runs, kRobotSeed), options.quick);
  report.note("beam: " + std::to_string(runs) +
              " runs of 200 readings of 0.5 mm, flange turned by up to 23 degrees about "
              "each axis, 120 to 250 mm");
  BeamScene beam;
  add_coverage(report, "robot.beam.plane", beam_coverage(beam, 200, runs, kRobotSeed), options.quick);
  beam.options.body = calibration::BeamBody::kSphere;
  add_coverage(report, "robot.beam.sphere", beam_coverage(beam, 200, runs, kRobotSeed), options.quick);
}

} // namespace bregma::bench
