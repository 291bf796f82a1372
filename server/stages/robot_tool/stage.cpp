#include "server/stages/robot_tool/stage.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <Eigen/Geometry>

#include "algorithms/geometry/angles.hpp"
#include "casefile/robot_tools.hpp"
#include "server/stages/host.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

constexpr std::int64_t kToolRepeat_ns = 500'000'000; // an arm that is lost is stated again at this interval

RobotToolCalibration calibration_of(const casefile::RobotToolModel &model) {
  RobotToolCalibration out;
  (void)wire::set_name(out.name, model.name); // its length was checked by the reader
  const auto rotation = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), model.axis);
  out.T_flange_tip.pose = {rotation, model.tip_mm};
  // Independent errors of the tip and of the axis about it, moved to the flange's origin.
  Matrix6d own = Matrix6d::Zero();
  own.diagonal().head<3>().setConstant(model.sigma_rad * model.sigma_rad);
  own.diagonal().tail<3>().setConstant(model.sigma_mm * model.sigma_mm);
  Matrix6d about_origin = Matrix6d::Identity();
  about_origin.bottomLeftCorner<3, 3>() = geometry::skew(model.tip_mm);
  out.T_flange_tip.covariance = about_origin * own * about_origin.transpose();
  return out;
}

} // namespace

void declare(base::ParameterSet &set, RobotToolParameters &p) {
  set.string("robot.tools", &p.tools, "File of the tools that arms carry (TOML); empty: none is calibrated.");
  set.string("robot.tool", &p.tool, "Tool of an arm that does not state which it carries; empty: none.");
  set.number("robot.tool_rate_hz", &p.rate_hz, "Hz", 0, 500, "Rate of the stage that makes poses of tools; 0: off.");
  set.number("robot.flange_sigma_mm", &p.flange_sigma_mm, "mm", 0.001, 10,
             "1-sigma error of each coordinate of the flange, for an arm that states no covariance.");
  set.number("robot.flange_sigma_deg", &p.flange_sigma_deg, "deg", 0, 10,
             "1-sigma error of the flange's rotation about each axis, for an arm that states no covariance.");
}

RobotToolStage::RobotToolStage(const RobotToolParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kFifo, .rate_hz = parameters.rate_hz}),
      options_{parameters.flange_sigma_mm, parameters.flange_sigma_deg * geometry::kRadiansPerDegree},
      states_(context.link), boot_id_(context.host.boot_id()) {
  if (!parameters.tools.empty()) {
    const auto equipment = casefile::read_robot_equipment(parameters.tools);
    if (!equipment) {
      throw std::invalid_argument("robot.tools: " + equipment.error().message);
    }
    for (const casefile::RobotToolModel &model : equipment->tools) {
      calibrations_.push_back(calibration_of(model));
    }
  }
  const bool known = std::any_of(calibrations_.begin(), calibrations_.end(), [&](const RobotToolCalibration &tool) {
    return wire::view(tool.name) == parameters.tool;
  });
  if (!parameters.tool.empty() && (!known || !wire::set_name(default_tool_, parameters.tool))) {
    throw std::invalid_argument("robot.tool = \"" + parameters.tool + "\": is not in the file of robot.tools");
  }
}

void RobotToolStage::connect(const runtime::LatestValue<RobotsView> &robots,
                             const runtime::LatestValue<ScannerPoseView> &scanner) {
  robots_.connect(robots);
  scanner_.connect(scanner);
}

void RobotToolStage::step(const Moment &now) noexcept {
  (void)robots_.refresh();
  (void)scanner_.refresh();
  const RobotsView &robots = robots_.value();
  const bool repeat = now.monotonic_ns - repeated_ns_ >= kToolRepeat_ns;
  repeated_ns_ = repeat ? now.monotonic_ns : repeated_ns_;
  view_.count = robots.count;
  for (std::uint32_t i = 0; i < robots.count; ++i) {
    const wire::RobotTool before = view_.tools[i];
    wire::RobotTool &out = view_.tools[i];
    out = tool_pose(robots.robots[i], calibrations_, default_tool_, scanner_.value(), options_, now.utc_ns);
    std::copy(boot_id_.begin(), boot_id_.end(), out.boot_id);
    out.published_boot_ns = now.boot_ns;
    const bool changed = before.status != out.status || before.scanner_status != out.scanner_status;
    // A live pose is published at every step: its remaining validity is new. One that is not live only says so.
    if (out.status == bregma_wire_POSE_LIVE || changed || repeat) {
      states_(out, now.utc_ns);
    }
  }
  tools.store(view_);
}

} // namespace bregma::server
