// Stage sensors: reads robot, range and force samples on a separate thread, so that a flooding sensor does not delay
// the navigation stage.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "base/parameters.hpp"
#include "idl/host_clock.hpp"
#include "server/inputs/input_guard.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct SensorParameters { // names, separated by commas
  std::string robots = "Robot";
  std::string forces = "Force";
  std::string ranges = "Range";
};
void declare(base::ParameterSet &set, SensorParameters &parameters);

class SensorStage final : public Stage {
public:
  static constexpr const char *kName = "sensors";
  using Parameters = SensorParameters;

  SensorStage(const SensorParameters &parameters, const StageContext &context);

  void step(const Moment &now) noexcept override;

  runtime::LatestValue<ForceView> force;              // per sample
  runtime::LatestValue<RobotsView> robots;            // per sample, and when one is lost
  runtime::LatestValue<inputs::StreamHealth> devices; // robots, ranges, forces; per tick
  // Every sample: one ring per reader. What does not fit is counted by the ring.
  FlangeRing flanges_to_navigation;
  FlangeRing flanges_to_scan;
  RangeRing readings;

private:
  // Who sends as a device.
  struct Origin {
    bool seen = false;
    std::uint64_t writer = 0;
    std::uint64_t frame = 0;
    std::uint32_t incarnation = 0;
    // Of this sample: see FlangeSample.
    std::uint32_t take(std::uint64_t new_writer, std::uint64_t new_frame) noexcept;
  };
  struct Arm {
    Origin origin;
    wire::RobotState last{};
  };
  void pass_on(const wire::RobotState &sample, const inputs::Verdict &verdict, std::uint64_t writer) noexcept;
  void take_range(const wire::RangeSample &sample, const inputs::Verdict &verdict, std::uint64_t writer) noexcept;
  void take_robot(const wire::RobotState &sample, const inputs::Verdict &verdict) noexcept;
  void take_motion(const wire::RobotMotionState &sample, const inputs::Verdict &verdict) noexcept;
  void watch_robots(const Moment &now) noexcept;

  RobotsView robots_view_;
  std::array<Arm, kMaxRobots> arms_;
  std::array<Origin, bregma_wire_MAX_DEVICES> range_origins_;
  inputs::InputGuard<wire::RobotState> robot_guard_;
  inputs::InputGuard<wire::RobotMotionState> motion_guard_;
  inputs::InputGuard<wire::RangeSample> range_guard_;
  inputs::InputGuard<wire::ForceSample> force_guard_;
  Subscriber<wire::RobotState> robots_;
  Subscriber<wire::RobotMotionState> motions_;
  Subscriber<wire::RangeSample> ranges_;
  Subscriber<wire::ForceSample> forces_;
  wire::BootIdentity boot_id_;
};

} // namespace bregma::server
