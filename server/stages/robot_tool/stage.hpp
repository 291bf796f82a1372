// Stage robot tool: poses of the tools that arms carry, in the arm's base and, with a valid registration of the
// scanner, in the scanner (tool_pose.hpp). The first of the robot's stages: others read `tools`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/parameters.hpp"
#include "idl/host_clock.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/robot_tool/tool_pose.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct RobotToolParameters {
  std::string tools; // file; empty: no tool is calibrated
  std::string tool;
  double rate_hz = 50.0;
  double flange_sigma_mm = ToolPoseOptions{}.flange_sigma_mm;
  double flange_sigma_deg = 0.05;
};
void declare(base::ParameterSet &set, RobotToolParameters &parameters);

class RobotToolStage final : public Stage {
public:
  static constexpr const char *kName = "robot tool";
  using Parameters = RobotToolParameters;

  // Throws std::invalid_argument for a file of tools that cannot be read, and for a tool that it does not have.
  RobotToolStage(const RobotToolParameters &parameters, const StageContext &context);
  void connect(const runtime::LatestValue<RobotsView> &robots, const runtime::LatestValue<ScannerPoseView> &scanner);

  void step(const Moment &now) noexcept override;

  runtime::LatestValue<RobotToolsView> tools;

private:
  ToolPoseOptions options_;
  std::vector<RobotToolCalibration> calibrations_;
  wire::Name default_tool_{};
  Publisher<wire::RobotTool> states_;
  wire::BootIdentity boot_id_;
  runtime::LatestInput<RobotsView> robots_;
  runtime::LatestInput<ScannerPoseView> scanner_;
  RobotToolsView view_;
  std::int64_t repeated_ns_ = 0; // monotonic
};

} // namespace bregma::server
