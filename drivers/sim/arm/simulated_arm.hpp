// An arm with its controller without hardware: bytes in, bytes out, in its own time. main.cpp puts it behind a socket.
//
// It moves along straight lines with limited speed and acceleration. The joints follow their setpoints with a delay. It
// states the pose that its nominal links give for the measured joints; where the flange really is follows from links
// that deviate from it. A motion that would leave a joint's limits or exceed its speed is refused before it begins.
//
// It moves only while `alive` arrives for the motion. Every stop is a ramp along the path, and latches until reset.
//
// Not for several threads at a time.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/robot/inverse_kinematics.hpp"
#include "algorithms/robot/straight_path.hpp"
#include "drivers/arm/arm_line.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/sim/random.hpp"

namespace bregma::sim {

struct ArmSettings {
  double max_speed_mm_s = 250.0; // along the path (robot::StraightPath)
  double acceleration_mm_s2 = 500.0;
  double stop_mm_s2 = 2000.0; // deceleration of a stop
  double max_joint_rad_s = 3.0;
  double follow_s = 0.012;        // the joints trail their setpoints by this time
  double max_following_rad = 0.1; // more is a fault
  double encoder_rad = 1e-6; // noise of each measured joint, 1 sigma: a standing arm does not repeat itself to the bit
  robot::JointAngles start = robot::JointAngles::Zero();
  std::string serial = "SIM1";
};

// The arm's links with errors: each joint's axis displaced and tilted, normal with these sigmas.
[[nodiscard]] robot::ArmModel with_link_errors(const robot::ArmModel &nominal, double sigma_mm, double sigma_rad,
                                               std::uint64_t seed);

class SimulatedArm {
public:
  static constexpr std::int64_t kTick_ns = 4'000'000;
  static constexpr unsigned kTicksPerMeasurement = 2; // measured_js, measured_cp
  static constexpr unsigned kTicksPerState = 10;      // operating_state, setpoint_js
  static constexpr unsigned kTicksPerScene = 4;       // of bregma-sim-arm: what a camera beside it sees

  // actual: the links as they are. Throws std::invalid_argument for an arm without closed inverse kinematics.
  SimulatedArm(const robot::ArmModel &nominal, const robot::ArmModel &actual, ArmSettings settings);

  // A connection begins; what the arm sends first.
  [[nodiscard]] std::string connect();
  // The connection is lost: a moving arm stops.
  void disconnect();
  // Received bytes; what it answers.
  [[nodiscard]] std::string receive(std::string_view bytes, std::int64_t now_ns);
  // Moves on to this time; what it sends meanwhile. After a pause the time of at most a second is made up.
  [[nodiscard]] std::string advance(std::int64_t now_ns);
  // A person leads the arm by its hand, in straight lines along these poses, at this speed. Why not, if it does not go:
  // a motion is under way, a stop is latched, or the way leaves the reach.
  [[nodiscard]] std::string lead(const std::vector<robot::FlangePose> &way, double speed_mm_s);
  [[nodiscard]] bool led() const { return led_.has_value(); }
  void press_emergency();
  void release_emergency() { emergency_ = false; }

  [[nodiscard]] bool moving() const { return speed_mm_s_ > 0.0 || following_rad() > 1e-6; }
  [[nodiscard]] const robot::JointAngles &joints() const { return joints_; }
  [[nodiscard]] robot::FlangePose stated_flange() const { return inverse_.model().forward(joints_); }
  [[nodiscard]] robot::FlangePose true_flange() const { return actual_.forward(joints_); }
  [[nodiscard]] arm::ArmState state() const { return state_; }
  [[nodiscard]] arm::FaultReason reason() const { return reason_; }
  // The flange comes to rest within this way after a stop now.
  [[nodiscard]] double stop_mm() const;
  [[nodiscard]] std::uint64_t motions_done() const { return motions_done_; }

private:
  [[nodiscard]] arm::Answer execute(const arm::Order &order);
  [[nodiscard]] arm::Answer execute(const arm::MoveCp &move);
  void alive(std::uint32_t motion, std::int64_t now_ns);
  // Why the planned path cannot be followed; empty: it can.
  [[nodiscard]] std::string problem_of(const robot::StraightPath &path, double speed_mm_s) const;
  void fault(arm::FaultReason reason);
  void tick();
  void drive();
  void follow_the_hand();
  void end_motion();
  [[nodiscard]] double following_rad() const { return (setpoint_ - joints_).cwiseAbs().maxCoeff(); }
  [[nodiscard]] std::string telemetry();
  [[nodiscard]] robot::JointAngles measured();
  [[nodiscard]] arm::OperatingState operating_state() const;

  robot::InverseKinematics inverse_; // of the nominal links
  robot::ArmModel actual_;
  ArmSettings settings_;
  driver::LineSplitter lines_{arm::kMaxLine};
  Random encoders_{0, "arm encoders"};

  arm::ArmState state_ = arm::ArmState::kDisabled;
  arm::FaultReason reason_ = arm::FaultReason::kNone;
  bool emergency_ = false;
  robot::JointAngles setpoint_, joints_;
  robot::JointAngles velocity_ = robot::JointAngles::Zero();

  std::optional<robot::StraightPath> planned_; // its waypoints are arriving
  std::optional<robot::StraightPath> path_;    // accepted; nullopt: no motion
  std::optional<robot::StraightPath> led_;     // by a person
  double led_mm_ = 0.0, led_mm_s_ = 0.0;
  std::uint32_t motion_ = 0;   // of planned_, path_ or the last one
  std::uint32_t expected_ = 0; // index of the next waypoint
  double commanded_mm_s_ = 0.0;
  double at_mm_ = 0.0;
  std::uint32_t waypoint_ = 0; // that it leads to; their number at the end
  double speed_mm_s_ = 0.0;
  bool started_ = false;    // by the first `alive`
  bool ramps_down_ = false; // hold or stop
  std::int64_t alive_ns_ = 0;
  std::uint64_t motions_done_ = 0;

  std::int64_t now_ns_ = 0; // of the last tick
  std::uint64_t ticks_ = 0;
  bool tell_state_ = true;
};

} // namespace bregma::sim
