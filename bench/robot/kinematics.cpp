// The Nachi MZ07F: poses of a real arm's teach pendant, and inverse against forward kinematics on random joint angles.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/robot/inverse_kinematics.hpp"
#include "base/csv_table.hpp"
#include "bench/robot/robot_parts.hpp"
#include "casefile/arm_files/arm_file.hpp"

namespace bregma::bench {

namespace {

using geometry::kRadiansPerDegree;
using robot::ArmModel;
using robot::FlangePose;
using robot::JointAngles;

constexpr double kSame_rad = 1e-6;
constexpr double kDistinct_rad = 1e-3;

ArmModel shipped_arm() {
  auto arm = casefile::read_arm("robots/mz07f.toml");
  if (!arm) {
    throw std::runtime_error(arm.error().message);
  }
  return *arm;
}

double apart_rad(const JointAngles &a, const JointAngles &b) {
  double out = 0.0;
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    out = std::max(out, std::abs(std::remainder(a[i] - b[i], 2.0 * std::numbers::pi)));
  }
  return out;
}

void pendant_figures(Report &report, const ArmModel &arm) {
  const std::filesystem::path file = "../shared/data/robot/mz07f_teach_pendant.csv";
  if (!std::filesystem::exists(file)) {
    report.note(file.string() + " is not here: its figures are left out");
    return;
  }
  const auto table = base::read_csv(file);
  if (!table) {
    throw std::runtime_error(table.error().message);
  }
  double worst_mm = 0.0;
  double worst_deg = 0.0;
  for (std::size_t row = 1; row < table->rows.size(); ++row) { // the first names the columns
    std::array<double, 12> value{};
    for (std::size_t i = 0; i < value.size(); ++i) {
      value[i] = table->number(table->rows[row].cells.at(i)).value_or(std::nan(""));
    }
    JointAngles joints;
    for (std::size_t i = 0; i < robot::kJoints; ++i) {
      joints[static_cast<Eigen::Index>(i)] = kRadiansPerDegree * value[i];
    }
    const auto turn = [&value](std::size_t column, int axis) {
      return Eigen::Quaterniond(Eigen::AngleAxisd(kRadiansPerDegree * value[column], Eigen::Vector3d::Unit(axis)));
    };
    const FlangePose shown(turn(9, 2) * turn(10, 1) * turn(11, 0), {value[6], value[7], value[8]});
    const FlangePose computed = arm.forward(joints);
    worst_mm = std::max(worst_mm, (computed.translation() - shown.translation()).norm());
    worst_deg = std::max(worst_deg, geometry::angle_between(computed.rotation(), shown.rotation()) / kRadiansPerDegree);
  }
  report.add(at_most("robot.kinematics.pendant.position.max", worst_mm, "mm", 0.07));
  report.add(at_most("robot.kinematics.pendant.rotation.max", worst_deg, "deg", 0.013));
}

// The number of branches of an arm with these choices: the wrist's centre within reach of each shoulder branch, two
// elbows, two wrists. Geometry of the plane of joint 1 only, apart from the inverse kinematics.
int expected_branches(const ArmModel &arm, const FlangePose &pose) {
  const auto &axes = arm.axes_at_zero();
  const Eigen::Vector3d wrist = pose * Eigen::Vector3d(0.0, 0.0, -78.0); // the last row of the table
  const double upper = (axes[2].point_mm - axes[1].point_mm).norm();
  const double fore = std::hypot(45.0, 340.0);
  const double out = std::hypot(wrist.x(), wrist.y());
  int branches = 0;
  for (const double side : {out, -out}) {
    const double distance = std::hypot(side - 50.0, wrist.z() - 355.0);
    branches += distance < upper + fore && distance > std::abs(upper - fore) ? 4 : 0;
  }
  return branches;
}

} // namespace

void kinematics_figures(Report &report, const RobotBenchOptions &options) {
  const ArmModel arm = shipped_arm();
  pendant_figures(report, arm);
  const robot::InverseKinematics inverse(arm);
  const int runs = options.quick ? 10'000 : 100'000;
  report.note("inverse kinematics: " + std::to_string(runs) + " random joint angles within the limits, seed " +
              std::to_string(kRobotSeed));
  std::mt19937 rng(kRobotSeed);
  double worst_mm = 0.0;
  double worst_rad = 0.0;
  int missed_generators = 0;
  int missed_branches = 0;
  int solutions = 0;
  int singular = 0;
  int nearest_is_generator = 0;
  const auto start = std::chrono::steady_clock::now();
  for (int run = 0; run < runs; ++run) {
    JointAngles joints;
    for (std::size_t i = 0; i < robot::kJoints; ++i) {
      const auto &limits = arm.limits()[i];
      joints[static_cast<Eigen::Index>(i)] =
          std::uniform_real_distribution<double>(limits.lower_rad, limits.upper_rad)(rng);
    }
    const FlangePose pose = arm.forward(joints);
    const robot::InverseResult result = inverse.solve(pose, joints);
    bool generator = false;
    for (const robot::ArmSolution &solution : result.all()) {
      const FlangePose back = arm.forward(solution.joints);
      worst_mm = std::max(worst_mm, (back.translation() - pose.translation()).norm());
      worst_rad = std::max(worst_rad, geometry::angle_between(back.rotation(), pose.rotation()));
      // Next to a singularity the joints are less exact than the pose.
      const double near = solution.singular() ? kDistinct_rad : kSame_rad;
      generator = generator || apart_rad(solution.joints, joints) < near;
      singular += solution.singular() ? 1 : 0;
    }
    solutions += static_cast<int>(result.count);
    missed_generators += generator ? 0 : 1;
    missed_branches += static_cast<int>(result.count) < expected_branches(arm, pose) ? 1 : 0;
    const auto nearest = inverse.nearest(pose, joints);
    nearest_is_generator += nearest && (nearest->joints - joints).cwiseAbs().maxCoeff() < kDistinct_rad ? 1 : 0;
  }
  const std::chrono::duration<double, std::micro> spent = std::chrono::steady_clock::now() - start;
  report.add(at_most("robot.kinematics.inverse.position.max", worst_mm, "mm", 1e-9));
  report.add(at_most("robot.kinematics.inverse.rotation.max", worst_rad, "rad", 1e-11));
  report.add(at_most("robot.kinematics.inverse.joints_missed", missed_generators, "poses", 0.0));
  report.add(at_most("robot.kinematics.inverse.branches_missed", missed_branches, "poses", 0.0));
  report.add(at_least("robot.kinematics.inverse.nearest_is_start", nearest_is_generator, "poses", runs));
  report.add(figure("robot.kinematics.inverse.branches", static_cast<double>(solutions) / runs, "per pose"));
  report.add(figure("robot.kinematics.inverse.singular", singular, "solutions"));
  report.add(figure("robot.kinematics.inverse.time", spent.count() / runs, "us per pose"));
}

} // namespace bregma::bench
