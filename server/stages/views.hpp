// Data exchanged between stages: plain structs for latest values. Lengths in mm, in Image unless stated otherwise;
// times ns UTC.
#pragma once

#include <cstdint>

#include "idl/topics.hpp"
#include "server/runtime/mailbox.hpp"
#include "server/runtime/spsc_ring.hpp"
#include "server/session/messages.hpp"
#include "server/stages/plausibility/body_judge.hpp"

namespace bregma::tissue {
class BrainModel;
}

namespace bregma::server {

class NodalFields;

// The navigated probe, input of the tissue model. The sensor in the probe's grip measures in the probe's body frame.
struct ProbeView {
  bool live = false; // a pose that is valid for navigation
  std::int64_t acquired_ns = 0;
  std::int64_t valid_until_ns = 0; // measuring is stricter than showing: not to be used after this time
  double tip_mm[3] = {};
  double shaft[3] = {};         // unit, in Image, from the tip up the shaft
  double shaft_in_tool[3] = {}; // the same in the probe's body
};

// The latest sample of the force sensor.
struct ForceView {
  std::int64_t acquired_ns = 0;
  double force_N[3] = {};
};

inline constexpr std::uint32_t kMaxRobots = 4; // arms of one daemon

// The latest state of each arm, in the order of devices.robots.
struct RobotView {
  wire::Name device{};
  wire::Name tool{}; // as stated by the arm
  std::uint64_t frame = 0;
  std::int64_t acquired_ns = 0; // 0: never seen
  std::int64_t period_ns = 0;
  bool lost = false;
  wire::RobotMode mode = bregma_wire_ROBOT_UNKNOWN;
  std::uint32_t joint_count = 0;
  double joint_position_rad[bregma_wire_MAX_JOINTS] = {};
  wire::Pose T_base_flange{};
  wire::PoseCovariance covariance{}; // all 0: not stated
  // Of the last two frames, while the later follows the earlier closely: left perturbation in RobotBase, rad/s and
  // mm/s.
  bool velocity_known = false;
  double velocity_per_s[6] = {};
  // As its driver states in RobotMotionState.
  std::int64_t motion_ns = 0; // when it was written; 0: never seen
  bool takes_permits = false;
  wire::RobotMotionPhase phase = bregma_wire_MOTION_UNKNOWN;
  wire::Name motion_client{};
  std::uint64_t motion_id = 0;
};
struct RobotsView {
  std::uint32_t count = 0;
  RobotView robots[kMaxRobots];
};

// Every measurement of an arm, for the stages that need each one: navigation without a tracker, and the surface scan.
struct FlangeSample {
  wire::Name device{};
  wire::Name tool{}; // as stated by the arm
  std::uint64_t frame = 0;
  std::int64_t acquired_ns = 0;
  std::int64_t age_sigma_ns = 0;
  std::int64_t period_ns = 0;
  std::int64_t written_ns = 0;
  // Changes when another driver writes or the count of the samples begins again: it may be another arm.
  std::uint32_t incarnation = 0;
  // Some measured value (joints, velocities, efforts, pose) differs from the last sample's. An arm that stands still
  // measures with noise; one whose values all repeat to the bit is frozen.
  bool measured_anew = false;
  wire::Pose T_base_flange{};
  wire::PoseCovariance covariance{}; // all 0: not stated
};
using FlangeRing = runtime::SpscRing<FlangeSample, 512>;

// The tracked reference in a frame that may be measured with, for the surface scan by an arm beside the tracker.
struct ReferenceSample {
  std::int64_t acquired_ns = 0;
  std::int64_t age_sigma_ns = 0;
  std::int64_t period_ns = 0;
  wire::Pose T_tracker_reference{};
  double covariance[36] = {};
};
using ReferenceRing = runtime::SpscRing<ReferenceSample, 256>;

// Of a tracker beside the arm (hand_eye_check.hpp).
struct HandEyeView {
  bool disagrees = false;
  std::int64_t checked_ns = 0; // exposure of the last frame that was judged, to which the rest belongs; 0: none yet
  double statistic = 0.0;
  double distance_mm = 0.0;
};

// The tracked reference in the last frame, for a motion of an arm beside the tracker.
struct ReferenceView {
  bool visible = false;
  bool trusted = false;         // its data are plausible
  std::int64_t acquired_ns = 0; // when it was seen last
  std::int64_t period_ns = 0;   // of the tracker
  std::int64_t limit_ns = 0;    // maximal age of a live pose
  wire::Pose T_tracker_reference{};
  double covariance[36] = {};
  HandEyeView hand_eye;
};

// Every accepted sample of a range sensor.
struct RangeReading {
  wire::Name device{};
  std::uint64_t frame = 0;
  std::int64_t acquired_ns = 0;
  std::int64_t period_ns = 0;
  std::uint32_t incarnation = 0; // as above
  double range_mm = 0.0;         // NaN: no reading
  double sigma_mm = 0.0;         // 0: not stated
};
using RangeRing = runtime::SpscRing<RangeReading, 4096>;

// Poses of the arms' tools, in the same order.
struct RobotToolsView {
  std::uint32_t count = 0;
  wire::RobotTool tools[kMaxRobots] = {};
};

// The accepted registration of the robot's base to the scanner, as long as it is valid.
struct ScannerPoseView {
  bool valid = false;
  wire::Name scanner{};
  wire::Pose T_base_scanner{};
  double covariance[36] = {};
};

// Commands of the scanner's procedure, and about the motion of an arm, from the session to their stages. Each gets one
// StageAnswer.
using ScannerInbox = runtime::Mailbox<wire::Command, 16>;
using RobotMotionInbox = runtime::Mailbox<wire::Command, 16>;
using StageAnswers = runtime::SpscRing<StageAnswer, 64>;

// The latest navigation states, for monitoring.
struct TrackingView {
  bool by_arm = false; // the case is navigated by an arm: the patient is not tracked
  bool reference_visible = false;
  wire::Name tracker{};         // empty before its first frame
  std::int64_t acquired_ns = 0; // of its last frame
  HandEyeView hand_eye;
  BodyReport reference;
  std::uint32_t tool_count = 0;
  struct Tool {
    wire::Name tool{};
    wire::PoseStatus status = bregma_wire_POSE_UNKNOWN;
    bool planned = false;
    std::int64_t age_ns = 0;
    wire::Pose T_image_tip{}; // NaN unless it is shown
    double tre_95_mm = 0.0;
    BodyReport body;
  } tools[bregma_wire_MAX_TOOLS];
};

// A tissue model, or nullptr if it cannot be made, for the case with this generation, which owns it.
struct TissueModelReady {
  std::uint64_t generation = 0;
  tissue::BrainModel *model = nullptr;
  NodalFields *fields = nullptr; // of the model
};

// Predicted positions of the case's targets, in its order.
struct PredictedTargets {
  std::uint64_t generation = 0; // generation of the case
  std::int64_t time_ns = 0;
  wire::DeformationStatus status[bregma_wire_MAX_TARGETS] = {};
  double position_mm[bregma_wire_MAX_TARGETS][3] = {};
};

// Steps of the wall clock, for the health topic.
struct ClockView {
  std::uint32_t steps = 0;       // since the start
  std::int64_t step_ns = 0;      // the last one, positive: forward
  std::int64_t step_time_ns = 0; // when it was noticed
};

// The session, for the health topic.
struct SessionView {
  wire::SessionState state = bregma_wire_SESSION_IDLE;
  std::uint64_t refused_commands = 0; // of clients that flood
  char case_folder[1024] = {};        // empty: no case is loaded
};

} // namespace bregma::server
