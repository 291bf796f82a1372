// Messages between the session (control thread) and the loops: plain data, for lock-free rings.
//
// One ring per loop and direction keeps the order of the messages. The session sends NavigationMessage,
// RegistrationMessage and MonitoringMessage. The loops send NavigationEvent, wire::RegistrationState and
// AlarmCondition. The session owns the set of samples, and the registration loop knows only the samples that the
// session sent. A restart can therefore restore it exactly.
//
// Positions of samples are those of the tip in Reference (mm). Covariances are row-major (mm^2). Times are ns UTC on
// the host's clock.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <variant>

#include "idl/topics.hpp"

namespace bregma::server {

using Array3 = std::array<double, 3>;
using Array9 = std::array<double, 9>;
using Array36 = std::array<double, 36>;

// ---- to the navigation loop ----

// Averages the tip in Reference over frames exposed in [start_ns, start_ns + window_ns]. The answer is exactly one
// CaptureResult with the same id, at the first frame or tick after the window's end.
struct CaptureRequest {
  std::uint64_t id;
  wire::CaptureKind kind; // CAPTURE_FIDUCIAL_TOUCH or CAPTURE_CHECK
  wire::Name tool;
  wire::Name point;
  std::int64_t start_ns;
  std::int64_t window_ns;
  double max_motion_mm; // maximal motion about the window's mean of a tip that was held still
};

// While on: a SurfaceSample event whenever the tip is spacing_mm away from the last sample.
struct TraceRequest {
  wire::Name tool;
  bool on;
  double spacing_mm;
};

// While on: a PivotPose event for every frame that shows the tool.
struct PivotRequest {
  std::uint64_t id; // copied into every pose, to recognize late poses of an earlier pivot
  wire::Name tool;
  bool on;
};

// A pivot-calibrated tip, in the tool's body frame. Without such a message the tool is POSE_NOT_CALIBRATED.
struct ToolTip {
  wire::Name tool;
  Array3 tip_mm;
  Array9 covariance_mm2;
};

// The plan of a tool. Empty trajectory: navigation without one. on == false: removes the tool's plan.
struct PlanSelected {
  wire::Name tool;
  wire::Name trajectory;
  bool on;
};

// A check touch was where it is expected: tool and reference are where they are shown.
struct TrackingConfirmed {
  wire::Name tool;
};

// ---- to navigation, registration and monitoring ----

// The registration accepted by the operator: T_image_reference exactly as navigation uses it from now on.
struct RegistrationAccepted {
  std::uint64_t revision;
  wire::Pose T_image_reference;
  Array36 covariance; // twist order of pose_covariance.hpp
  Array3 excess_mm;   // of a range sensor on tilted skin, and its slopes (tilt_excess.hpp); 0: none is known
};

// All samples and the accepted registration are void.
struct RegistrationReset {
  std::uint64_t revision;
};

// state: the state shown to clients. verified: the operator has verified the accepted registration. It stays true while
// a Degraded session waits to resume. A pose can be POSE_LIVE only if verified is true, otherwise at most
// POSE_UNVERIFIED.
struct SessionChanged {
  wire::SessionState state;
  bool verified;
};

// ---- to the registration loop ----
// Every change of the sample set carries the set's new revision. RegistrationState::revision is the revision of the
// last change that the estimate contains. So an estimate that lacks a sample cannot be accepted.

struct FiducialSample { // replaces an earlier sample of the same point
  std::uint64_t revision;
  wire::Name tool;
  wire::Name point;
  std::uint64_t frame; // the last averaged frame
  std::int64_t acquired_time_ns;
  Array3 position_mm;
  Array9 covariance_mm2; // tracker, tip and averaging; not the placement error of the touch (limits.fle_touch_mm)
  Array9 common_mm2;     // that all touches have in common (hand-eye); not part of covariance_mm2
};

struct FiducialRemoved {
  std::uint64_t revision;
  wire::Name point;
};

// A sample traced while Registering joins the set. Later samples go only to the monitoring loop, for the drift test.
struct SurfaceSample {
  std::uint64_t revision; // set by the session if the sample joins the set; 0 from navigation
  wire::Name tool;
  std::uint64_t frame;
  std::int64_t acquired_time_ns;
  Array3 position_mm;
  Array9 covariance_mm2;
  // Error that all samples of one scan have in common (beam and curve of the sensor, hand-eye); not part of
  // covariance_mm2.
  Array9 common_mm2;
  // Of a sample by a range sensor that reads too far on tilted skin: unit, against the beam, and across it, fixed in
  // the sensor; in Reference. Else 0. The position is as measured, too far.
  Array3 towards_sensor, across;
};

// ---- to the monitoring loop ----

// A check touch: the measurement and its comparison with the accepted registration.
struct JudgedCheck {
  wire::Name tool;
  wire::Name landmark;
  std::uint64_t frame;
  std::int64_t acquired_time_ns;
  Array3 position_mm; // position of the tip, in Reference
  Array9 covariance_mm2;
  // In Image, by the accepted registration:
  std::uint32_t landmark_index; // in the case's list
  Array3 error_mm;              // displayed tip minus landmark
  Array9 touch_covariance_mm2;  // error of this touch: tracker, tip and placement (limits.fle_touch_mm)
  double distance_mm;           // length of error_mm
  double limit_mm;              // 95 % bound of distance_mm if nothing has moved: registration, landmark and touch
};

// Restarts the sequential drift test: the operator has acknowledged the alarm, or the checks were voided.
struct DriftRestart {
  std::int64_t time_ns;
};

// ---- to the stage surface scan ----

// While on: a SurfaceSample event, with the sensor as its tool, whenever the point that the beam meets is spacing_mm
// away from the last one. The other fields are the sensor's calibration, valid if on (casefile/robot_tools.hpp).
inline constexpr std::size_t kMaxCurvePoints = 16;
struct CurvePoint {
  double reading, add_mm;
};
struct ScanRequest {
  bool on;
  wire::Name arm;
  wire::Name sensor;
  double spacing_mm;
  Array3 origin_mm, direction;
  Array36 beam_covariance;
  bool curved;
  double curve_scale_mm, curve_exponent;
  std::array<double, 4> curve_covariance; // of scale and exponent
  double curve_rms_mm;                    // that law and corrections do not fit
  std::uint32_t curve_points;             // corrections of the law, by increasing readings
  std::array<CurvePoint, kMaxCurvePoints> curve_corrections;
  bool reads_tilted;   // tilted skin too far
  std::int64_t window; // readings
  std::int64_t delay_ns;
  double sigma_mm; // 0: as the sensor states
  double near_mm, far_mm;
  // A tracker beside the arm: points are those of its reference. Else they are in the arm's base, and the rest is not
  // valid.
  bool beside_tracker;
  wire::Name reference;
  wire::Pose T_base_tracker;
  Array36 tracker_covariance; // of T_base_tracker
};

// ---- from the registration loop ----

// Beside what is published of an estimate, what an accepted one keeps.
struct RegistrationEstimate : wire::RegistrationState {
  Array3 excess_mm; // as in RegistrationAccepted
};

// ---- from the navigation loop ----

enum class CaptureStatus : std::uint8_t {
  kOk,
  kNoFrames,        // the tracker was silent
  kToolHidden,      // the tool was seen in too few of the window's frames
  kReferenceHidden, // the reference was seen in too few of them
  kNotNew,          // too many of them repeated an old pose or came late
  kImplausible,     // too many of them were implausible (server/stages/plausibility)
  kMoved,           // see CaptureResult::motion_mm
  kNotCalibrated    // the tool has no tip
};

struct CaptureResult {
  std::uint64_t id;
  CaptureStatus status;
  std::uint32_t used_frames;
  std::uint32_t window_frames; // all frames exposed in the window
  std::uint64_t frame;         // the last frame used
  std::int64_t acquired_time_ns;
  Array3 position_mm;    // mean; this and the next fields only with kOk, motion_mm also with kMoved
  Array9 covariance_mm2; // covariance of the mean
  Array9 common_mm2;     // error that all touches with an arm's tool have in common: hand-eye; not part of the former
  double motion_mm;      // motion of the tip about the mean, beyond the noise of the markers
};

struct PivotPose {
  std::uint64_t id; // id of the PivotRequest
  std::uint64_t frame;
  std::int64_t acquired_time_ns;
  wire::Pose T_tracker_tool;
  bool reference_visible;
  wire::Pose T_reference_tool; // only with reference_visible
};

// In a case without a tracker: another driver sends for the arm, or the arm counts anew. It may be another arm, or one
// that stands elsewhere: samples taken before belong to another base.
struct ArmReplaced {
  std::int64_t time_ns;
};

// ---- from the stages scanner and robot motion ----

// The answer to a command that the session passed on to them.
struct StageAnswer {
  wire::Name client; // this and the next three as in the command
  std::uint64_t id;
  std::int64_t sent_time_ns;
  wire::CommandKind kind;
  wire::CommandResult result;
  char text[256];
  bool by_device; // a device has published this reply: the session does not publish it again
};

// ---- from monitoring, inputs and recorder ----

enum class SessionEffect : std::uint8_t {
  kNone,    // is only shown
  kDegrade, // Degraded while the condition lasts, then the session resumes automatically
  kDemote,  // back to Registered; the operator must verify again
  kFault    // left only by CLOSE_CASE or a restart
};

// A condition that began (active) or ended, after its hysteresis. Changes must be sent; repetitions are harmless.
struct AlarmCondition {
  wire::Name kind;
  wire::Name subject; // may be empty
  bool active;
  wire::AlarmSeverity severity;
  SessionEffect effect;
  std::int64_t time_ns;
  char text[256];
};

using NavigationMessage = std::variant<SessionChanged, CaptureRequest, TraceRequest, PivotRequest, ToolTip,
                                       PlanSelected, RegistrationAccepted, RegistrationReset, TrackingConfirmed>;
using RegistrationMessage = std::variant<SessionChanged, FiducialSample, FiducialRemoved, SurfaceSample,
                                         RegistrationAccepted, RegistrationReset>;
using MonitoringMessage =
    std::variant<SessionChanged, JudgedCheck, SurfaceSample, DriftRestart, RegistrationAccepted, RegistrationReset>;
using NavigationEvent = std::variant<CaptureResult, SurfaceSample, PivotPose, ArmReplaced>;

static_assert(std::is_trivially_copyable_v<NavigationMessage> && std::is_trivially_copyable_v<RegistrationMessage> &&
              std::is_trivially_copyable_v<MonitoringMessage> && std::is_trivially_copyable_v<NavigationEvent> &&
              std::is_trivially_copyable_v<AlarmCondition> && std::is_trivially_copyable_v<ScanRequest> &&
              std::is_trivially_copyable_v<StageAnswer>);

// Names of alarms, common to the senders, the session and the command line.
namespace alarm {
inline constexpr const char *kTrackerLost = "tracker_lost";   // degrades
inline constexpr const char *kDeviceLost = "device_lost";     // another device
inline constexpr const char *kRobotLost = "robot_lost";       // the arm of a case without a tracker; degrades
inline constexpr const char *kCheckExpired = "check_expired"; // demotes: the patient is not tracked
inline constexpr const char *kScanStalled = "scan_stalled";
inline constexpr const char *kScanLost = "scan_lost"; // readings without a place
inline constexpr const char *kScanInterrupted = "scan_interrupted";
inline constexpr const char *kHandEye = "hand_eye"; // the tracker is not where it was calibrated against the arm
inline constexpr const char *kHandEyeUnchecked = "hand_eye_unchecked"; // nothing watches that calibration
inline constexpr const char *kGuideOffPlan = "guide_off_plan"; // at the end of its motion; its subject is the arm
inline constexpr const char *kReferenceHidden = "reference_hidden";
inline constexpr const char *kToolHidden = "tool_hidden";
inline constexpr const char *kDrift = "drift";              // demotes
inline constexpr const char *kCheckMissed = "check_missed"; // demotes: check touches far from their landmarks
inline constexpr const char *kImplausible = "implausible";  // data of a tool or the reference are refused
inline constexpr const char *kUnknownTool = "unknown_tool";
inline constexpr const char *kUnknownDevice = "unknown_device";
inline constexpr const char *kLatency = "latency";
inline constexpr const char *kRejected = "rejected_samples";
inline constexpr const char *kDeviceRate = "device_rate"; // contradicts the stated one
inline constexpr const char *kWallClock = "wall_clock";   // was stepped
inline constexpr const char *kDisk = "disk";
inline constexpr const char *kOverrun = "overrun";                // its subject is the loop
inline constexpr const char *kRecordingSpace = "recording_space"; // little is left
inline constexpr const char *kRecordLoss = "record_loss";
inline constexpr const char *kOtherDaemon = "other_daemon"; // a second daemon on the domain
inline constexpr const char *kStateUser =
    "state_directory";                                      // a second daemon on the state directory, which was refused
inline constexpr const char *kOtherWriter = "other_writer"; // of a device
inline constexpr const char *kCommandFlood = "command_flood";   // its subject is the client
inline constexpr const char *kSlicesRefused = "slices_refused"; // of the scanner
inline constexpr const char *kScannerMoved = "scanner_moved";   // its registration is void
inline constexpr const char *kCoilsOn = "coils_on";             // coils that could not be switched off
} // namespace alarm

} // namespace bregma::server
