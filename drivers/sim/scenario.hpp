// Scenario of a simulated operation: parameters of the room, steps of the operator and faults, read from one TOML file.
// All keys except the steps have defaults. Lengths in mm, times in the unit of the name.
//
//   [tracker] [operator] [patient] [robot] [sensors] [limits]   parameters, see the structs
//   [[steps]]   do = "touch_fiducials", tool = "Stylus"          in order
//   [[faults]]  kind = "reference_bump", step = "follow_trajectory", after_s = 2.0, magnitude_mm = 2.0
//
// Errors of the reader name file, line, key, value and problem. Unknown keys are refused.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "base/result.hpp"
#include "casefile/run_limits.hpp"

namespace bregma::sim {

struct TrackerParameters {
  double rate_hz = 250.0;
  double noise_lateral_mm = 0.10; // standard deviation of a marker across the line of sight (x, y of the tracker)
  double noise_depth_mm = 0.25;   // standard deviation along it (z of the tracker)
  double max_marker_angle_deg = 60.0;
  double near_mm = 950.0; // measuring volume: a frustum about z
  double far_mm = 2400.0;
  double half_width_deg = 30.0;
  double half_height_deg = 26.0;
  double delay_ms = 4.0;           // exposure to delivery
  double delay_jitter_ms = 0.3;    // mean of the additional exponential delay
  double missing_share = 0.0;      // fraction of the frames that is lost at random between device and driver
  double clock_offset_ms = 1500.0; // device clock minus host clock at the start
  double clock_drift_ppm = 20.0;   // a positive drift: the device's clock runs fast
  double clock_jitter_ms = 0.02;   // standard deviation of a time stamp
};

struct OperatorParameters {
  double hand_speed_mm_s = 350.0; // mean speed of free movements
  double standoff_mm = 45.0;      // start and end of a touch, along the skin's normal
  double tremor_mm = 0.10;        // standard deviation per coordinate, 8-12 Hz, tool in the air
  double tremor_deg = 0.15;       // 1-sigma a coordinate
  double wander_mm = 0.40;        // standard deviation per coordinate, below 0.7 Hz, tool in the air
  double wander_deg = 0.50;
  double rest_share = 0.15;        // remaining fraction of both in position if the tip rests on a surface
  double touch_error_scale = 1.0;  // 1: exactly limits.fle_touch_mm of the case
  double settle_s = 0.4;           // time at rest before a command
  double steering_time_s = 0.8;    // time constant of the correction of the displayed deviation
  double display_patience_s = 0.3; // maximal age of a display used for steering
  double reply_timeout_s = 10.0;
  double give_up_s = 30.0;   // maximal time without a live display on a trajectory
  std::int64_t attempts = 3; // maximal attempts per touch
  bool hands_only = false;   // moves the tools and waits for a person's commands, of which it shows the next
};

struct PatientParameters {
  Eigen::Vector3d camera_direction = {0.25, 0.90, -0.20}; // from the head's centre, in the image (RAS)
  double camera_distance_mm = 1600.0;
  Eigen::Vector3d reference_offset_mm = {-125.0, 75.0,
                                         20.0}; // centre of its markers, from the head's centre, in the image
  double fle_image_scale = 1.0;                 // 1: exactly limits.fle_image_mm of the case
  double landmark_error_scale = 1.0;            // 1: exactly limits.landmark_sigma_mm of the case
  double skin_sigma_mm = 0.4;                   // standard deviation of true minus segmented skin, along the normal
  double skin_correlation_mm = 12.0;
  double tip_offset_mm = 0.7; // distance of true and nominal tip, in a random direction
};

struct RobotParameters {
  double rate_hz = 100.0;
  double speed_mm_s = 80.0;        // speed of the guide to its position
  double guide_distance_mm = 90.0; // flange to entry, along the planned line
  double placement_error_mm = 1.0; // standard deviation per coordinate of the guide, before steering
  double encoder_noise_mrad = 0.01;
};

// Parameters of the brain for the force on the probe.
struct TissueParameters {
  double young_Pa = 3000.0;   // stiffer than in the daemon ([thesis]: 2100), to test its force correction
  double tip_radius_mm = 3.0; // radius of the probe's tip
  double rupture_N = 0.12;    // rupture force of the surface
  double cutting_N = 0.06;    // force at the tip after the rupture
  double friction_N_per_mm = 0.0006;
};

struct SensorParameters {
  double force_rate_hz = 200.0;
  double force_noise_N = 0.005; // a six-axis cell of 12 N full scale resolves 0.003
  double range_rate_hz = 50.0;
  double range_noise_mm = 0.5;
};

enum class StepKind {
  kLoadCase,
  kPivot,
  kStartRegistration,
  kTouchFiducials,
  kTraceScalp,
  kAcceptRegistration,
  kCheckLandmarks,
  kConfirmVerification,
  kStartNavigation,
  kFollowTrajectory,
  kWait,
  kStopNavigation,
  kCloseCase
};

[[nodiscard]] std::string_view name_of(StepKind kind);

struct Step {
  StepKind kind = StepKind::kWait;
  std::string name;                // name used by faults and the truth; default: the kind's name
  std::string tool;                // if the kind has one
  std::string trajectory;          // kStartNavigation, kFollowTrajectory
  std::vector<std::string> points; // touches: these, or all of the case
  double duration_s = 0.0;         // kPivot, kWait; kFollowTrajectory: held at the target
  double length_mm = 0.0;          // kTraceScalp: path length on the skin
  double speed_mm_s = 0.0;         // kTraceScalp, kFollowTrajectory
  bool may_fail = false;           // a failure is reported and the script continues
};

enum class FaultKind { kOcclusion, kTrackerSilent, kReferenceBump, kClockJump, kBadSamples, kFlood };

enum class BadSample {
  kNotFinite,
  kNotARotation,
  kTimeBackwards,
  kTimeInFuture,
  kUnknownDevice,
  kUnknownTool,
  kDuplicate,
  kMalformed
};

struct Fault {
  FaultKind kind = FaultKind::kOcclusion;
  std::string step; // starts after_s after the first start of this step; empty: after the run's start
  double after_s = 0.0;
  double duration_s = 0.0;                  // kOcclusion, kTrackerSilent, kFlood
  std::string tool;                         // kOcclusion
  std::string device;                       // kFlood: the flooding device
  double magnitude_mm = 0.0;                // kReferenceBump, in a random direction unless vector_mm is given
  std::optional<Eigen::Vector3d> vector_mm; // kReferenceBump, in the image's axes
  double jump_ms = 0.0;                     // kClockJump
  BadSample sample = BadSample::kNotFinite; // kBadSamples
  std::int64_t count = 0;                   // kBadSamples
  double factor = 0.0;                      // kFlood
};

struct Scenario {
  TrackerParameters tracker;
  OperatorParameters hand;
  PatientParameters patient;
  RobotParameters robot;
  TissueParameters tissue;
  SensorParameters sensors;
  std::vector<Step> steps;
  std::vector<Fault> faults;
  casefile::RunLimits limits;
};

// The tables of parameters. The reader keeps errors.
void read_parameters(base::TableReader &root, Scenario &scenario);

[[nodiscard]] base::Result<Scenario> load_scenario(const std::filesystem::path &file);
// name: the file's name in messages.
[[nodiscard]] base::Result<Scenario> parse_scenario(std::string_view toml, const std::string &name);

} // namespace bregma::sim
