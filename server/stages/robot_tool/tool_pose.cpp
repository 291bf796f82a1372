#include "server/stages/robot_tool/tool_pose.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/uncertainty/tre.hpp"
#include "idl/validity.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

using geometry::frame::RobotFlange;
using geometry::frame::Tip;
using mri::frame::Base;
using mri::frame::Device;

void clear_poses(wire::RobotTool &out) noexcept {
  out.T_base_tip = out.T_scanner_tip = wire::unknown_pose();
  put_unknown(out.covariance);
  put_unknown(out.scanner_covariance);
  out.scanner_error_95_mm = wire::kUnknown;
}

// With the way that the flange may have gone since the frame, as large as at its velocity, whichever way.
Matrix6d moved_covariance(const RobotView &robot, const Vector3d &origin_mm, std::int64_t age_ns,
                          const ToolPoseOptions &options) noexcept {
  const geometry::Vector6d motion = 1e-9 * static_cast<double>(age_ns) * geometry::Vector6d::Map(robot.velocity_per_s);
  return flange_covariance(robot.covariance, origin_mm, options) + motion * motion.transpose();
}

const RobotToolCalibration *find(std::span<const RobotToolCalibration> tools, const wire::Name &name) noexcept {
  const auto found =
      std::find_if(tools.begin(), tools.end(), [&](const RobotToolCalibration &tool) { return same(tool.name, name); });
  return found != tools.end() ? &*found : nullptr;
}

wire::PoseStatus status_of(const RobotView &robot, const RobotToolCalibration *tool, std::int64_t age_ns,
                           std::int64_t limit_ns) noexcept {
  if (robot.acquired_ns == 0 || robot.lost || !robot.velocity_known) {
    return bregma_wire_POSE_LOST;
  }
  if (tool == nullptr) {
    return bregma_wire_POSE_NOT_CALIBRATED;
  }
  return age_ns < 0 || age_ns > limit_ns ? bregma_wire_POSE_STALE : bregma_wire_POSE_LIVE;
}

} // namespace

Matrix6d flange_covariance(const wire::PoseCovariance &stated, const Vector3d &origin_mm,
                           const ToolPoseOptions &options) noexcept {
  if (std::any_of(std::begin(stated), std::end(stated), [](float v) { return v != 0.0F; })) {
    Matrix6d out;
    for (std::size_t row = 0; row < 6; ++row) {
      for (std::size_t column = row; column < 6; ++column) {
        const auto i = static_cast<Eigen::Index>(row);
        const auto j = static_cast<Eigen::Index>(column);
        out(i, j) = out(j, i) = double{stated[wire::upper_index(row, column)]};
      }
    }
    return out;
  }
  Matrix6d own = Matrix6d::Zero();
  own.diagonal().head<3>().setConstant(options.flange_sigma_rad * options.flange_sigma_rad);
  own.diagonal().tail<3>().setConstant(options.flange_sigma_mm * options.flange_sigma_mm);
  Matrix6d about_origin = Matrix6d::Identity(); // from a perturbation about the flange to one about Base's origin
  about_origin.bottomLeftCorner<3, 3>() = geometry::skew(origin_mm);
  return about_origin * own * about_origin.transpose();
}

wire::RobotTool tool_pose(const RobotView &robot, std::span<const RobotToolCalibration> tools,
                          const wire::Name &default_tool, const ScannerPoseView &scanner,
                          const ToolPoseOptions &options, std::int64_t now_ns) noexcept {
  wire::RobotTool out{};
  clear_poses(out);
  copy_name(out.device, robot.device);
  copy_name(out.tool, robot.tool[0] != '\0' ? robot.tool : default_tool);
  copy_name(out.scanner, scanner.scanner);
  out.frame = robot.frame;
  out.mode = robot.mode;
  out.acquired_time_ns = robot.acquired_ns;
  out.published_time_ns = now_ns;
  out.age_ns = robot.acquired_ns != 0 ? now_ns - robot.acquired_ns : 0;
  const std::int64_t limit_ns = wire::live_limit_ns(wire::kLiveLimit_ms, robot.period_ns);
  const RobotToolCalibration *tool = find(tools, out.tool);
  out.status = status_of(robot, tool, out.age_ns, limit_ns);
  out.scanner_status = out.status;
  if (out.status != bregma_wire_POSE_LIVE) {
    return out;
  }
  geometry::UncertainPose<Base, RobotFlange> T_base_flange;
  T_base_flange.pose = wire::from_wire<Base, RobotFlange>(robot.T_base_flange);
  T_base_flange.covariance = moved_covariance(robot, T_base_flange.pose.translation(), out.age_ns, options);
  const geometry::UncertainPose<Base, Tip> T_base_tip = T_base_flange * tool->T_flange_tip;
  out.T_base_tip = wire::to_wire(T_base_tip.pose);
  put(T_base_tip.covariance, out.covariance);
  out.valid_for_ns = limit_ns - out.age_ns;
  if (!scanner.valid) {
    out.scanner_status = bregma_wire_POSE_NOT_REGISTERED;
    return out;
  }
  geometry::UncertainPose<Base, Device> T_base_scanner;
  T_base_scanner.pose = wire::from_wire<Base, Device>(scanner.T_base_scanner);
  T_base_scanner.covariance = RowMajor<6>::Map(scanner.covariance);
  const auto T_scanner_tip = geometry::inverse(T_base_scanner) * T_base_tip;
  const Matrix3d position = uncertainty::tre_covariance(T_scanner_tip.covariance, T_scanner_tip.pose.translation());
  out.T_scanner_tip = wire::to_wire(T_scanner_tip.pose);
  put(T_scanner_tip.covariance, out.scanner_covariance);
  out.scanner_error_95_mm = uncertainty::ellipsoid_95(position).semi_axes_mm[0];
  return out;
}

} // namespace bregma::server
