// Evaluation of a session file: figures for `bregma report`, its JSON and its pages.
//
// Times are ns UTC as recorded, lengths mm. NaN and empty optionals mean that the file does not contain the value.
// Without the simulator's truth, true errors are unknown, never 0. Pure functions of the file; one thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"
#include "casefile/case.hpp"
#include "casefile/session_file/session_file.hpp"

namespace bregma::cli::report {

// A sample counts as held at the target when the shown tip is within these distances (mm).
inline constexpr double kAtTargetDepth_mm = 1.0;    // along the trajectory
inline constexpr double kAtTargetDistance_mm = 3.0; // in all

// Nearest rank: the smallest value that at least this fraction of the samples does not exceed.
struct Distribution {
  std::vector<double> sorted;
  [[nodiscard]] std::size_t count() const { return sorted.size(); }
  [[nodiscard]] double percentile(double fraction) const; // NaN when empty
  [[nodiscard]] double max() const { return percentile(1.0); }
};

// One published tip that was live or unverified, once per tool and tracker frame.
struct TipSample {
  std::int64_t time_ns = 0;
  std::uint32_t tool = 0; // index into SessionAnalysis::tools
  bool at_target = false;
  double predicted_rms_mm = geometry::kUnknown; // TRE at the tip
  double true_error_mm = geometry::kUnknown;    // |shown tip - true tip|
  double ellipsoid = geometry::kUnknown; // squared true error in units of the semi-axes: up to 1 inside the 95 % region
};

// Figures while the tip was held at the target of the navigated plan.
struct AtTarget {
  std::string tool;
  std::string trajectory;
  std::size_t samples = 0;
  double shown_distance_mm = geometry::kUnknown; // median, shown tip to target
  Distribution true_error_mm;                    // empty without truth
  double predicted_rms_mm = geometry::kUnknown;  // median
  double lateral_mm = geometry::kUnknown;        // median lateral deviation
  double inside_share = geometry::kUnknown; // fraction of the samples with truth inside the predicted 95 % ellipsoid
  std::optional<bool> inside;               // more than half of them are inside
  double registration_error_mm = geometry::kUnknown; // true error of the accepted registration at the true tip
};

struct TargetPrediction {
  std::string target;
  double tre_rms_mm = geometry::kUnknown;
  double tre_95_mm = geometry::kUnknown; // longest semi-axis
  double image_rms_mm = 0.0; // part of tre_rms_mm: the registration of the image in which the target was placed
};

struct FiducialFigure {
  std::string fiducial;
  double residual_mm = geometry::kUnknown;
  double leave_one_out_mm = geometry::kUnknown;
  double p_value = geometry::kUnknown;
  bool suspect = false;
};

struct RegistrationSummary { // the last accepted registration
  std::int64_t accepted_time_ns = 0;
  std::uint64_t revision = 0;
  std::uint32_t fiducials = 0;
  std::uint32_t surface_points = 0;
  double fre_mm = geometry::kUnknown; // consistency of the fiducials, not the error at the target
  double surface_rms_mm = geometry::kUnknown;
  Eigen::Matrix4d T_image_reference = Eigen::Matrix4d::Constant(geometry::kUnknown);
  std::vector<TargetPrediction> targets;
  std::vector<FiducialFigure> residuals;
};

struct CheckRecord {
  std::int64_t time_ns = 0;
  std::string tool;
  std::string landmark;
  double distance_mm = geometry::kUnknown;
  double limit_mm = geometry::kUnknown; // 95 % bound if nothing has moved
};

// The shown tip while it follows a plan, once per tracker frame.
struct PathSample {
  std::int64_t time_ns = 0;
  std::string trajectory;
  Eigen::Vector3d tip_mm = Eigen::Vector3d::Constant(geometry::kUnknown); // in Image
  double remaining_depth_mm = geometry::kUnknown;
  double lateral_mm = geometry::kUnknown;
};

// The largest lateral deviation between entry and target, of the pass that came nearest to the target. None where the
// tool was never nearer to the target than the entry is.
struct PathSummary {
  std::string trajectory;
  std::int64_t time_ns = 0;
  double largest_lateral_mm = geometry::kUnknown;
  double remaining_depth_mm = geometry::kUnknown;
};

// The end of a pivot calibration.
struct PivotRecord {
  std::int64_t time_ns = 0;
  std::string tool;
  bool accepted = false;
  double rms_mm = geometry::kUnknown; // residual of the poses
  std::string text;                   // the daemon's answer
};

// Closest approach of the navigated tip to one critical structure.
struct Approach {
  std::string structure;
  std::string tool;
  std::int64_t time_ns = 0;
  double shown_mm = geometry::kUnknown;
  double true_at_least_mm = geometry::kUnknown; // minimum of the shown distance less the true error of the tip
};

// One answer of the tissue model about a target, while the probe touched the tissue.
struct TissueSample {
  std::int64_t time_ns = 0;
  std::string phase;  // indentation, penetration, withdrawal
  std::string status; // valid, extrapolating, invalid
  double depth_mm = geometry::kUnknown;
  double tip_force_N = geometry::kUnknown;
  double shaft_force_N = geometry::kUnknown;
  double measured_force_N = geometry::kUnknown;
  double von_mises_Pa = geometry::kUnknown;   // at the target
  double motion_mm = geometry::kUnknown;      // predicted motion of the target
  double error_bound_mm = geometry::kUnknown; // bound of its error
  bool still = false;                         // the probe stands still: its depth says nothing about the course
};

struct FollowedLandmark {
  std::string landmark; // name of a landmark in the brain
  double largest_motion_mm = geometry::kUnknown;
  double error_bound_mm = geometry::kUnknown; // bound of the motion's error
};

// The probe's insertion as followed by the tissue model, with the target that moved most.
struct InsertionAnalysis {
  std::string target;
  std::uint32_t elements = 0;
  std::vector<TissueSample> samples; // in the order of publication
  std::uint32_t ruptures = 0;
  double rupture_force_N = geometry::kUnknown;  // modelled force at the first rupture
  double rupture_depth_mm = geometry::kUnknown; // depth of the indentation before the first rupture
  double largest_motion_mm = geometry::kUnknown;
  double stiffness_scale = geometry::kUnknown; // at the end: measured over modelled force
  std::map<std::string, std::size_t> states;   // samples by status
  std::map<std::string, std::size_t> reasons;
  std::vector<FollowedLandmark> landmarks; // by name
};

struct AlarmChange {
  std::int64_t time_ns = 0;
  std::string kind;
  std::string subject;
  std::string state;    // raised, acknowledged, cleared
  std::string severity; // info, warning, critical
  std::string text;
};

struct StateSpan {
  std::int64_t from_ns = 0;
  std::int64_t to_ns = 0;
  std::string state;
};

struct DeviceSummary {
  std::string device;
  std::string kind;
  double rate_hz = geometry::kUnknown; // last rate while the device was live
  std::uint64_t taken = 0;
  std::uint64_t lost = 0;
  std::uint64_t late = 0;
  std::uint64_t connections = 0;
  std::map<std::string, std::uint64_t> rejected; // number by reason, if not 0
};

struct LoopSummary {
  std::string loop;
  double rate_hz = 0.0; // 0: by event
  std::uint64_t steps = 0;
  std::uint64_t overruns = 0;
  double step_p50_us = geometry::kUnknown;
  double step_p99_us = geometry::kUnknown;
  double step_max_us = geometry::kUnknown;
};

struct TracePoint {
  Eigen::Vector3d on_scalp_mm; // in Image: the scalp's point closest to the registered sample
  double residual_mm = 0.0;    // distance of the sample from it, negative inside
};

struct SessionAnalysis {
  std::vector<casefile::MetaEntry> meta;
  std::int64_t start_ns = 0; // time of the first record
  std::int64_t end_ns = 0;   // time of the last record
  std::uint64_t records = 0;
  std::uint64_t tracker_frames = 0;
  bool has_truth = false;
  std::optional<std::uint64_t> seed; // of the simulated run

  std::vector<std::string> tools;
  std::vector<TipSample> tips;           // in the order of publication
  Distribution exposure_to_published_ms; // states of a new frame only, not their repetitions at the floor rate
  Distribution sent_to_published_ms;
  double navigation_rate_hz = geometry::kUnknown; // rate of the navigated tool's states while navigating
  bool navigated = false;
  bool verified_before_navigation = false;

  std::optional<RegistrationSummary> registration;
  std::optional<AtTarget> at_target;
  std::optional<std::size_t> structures;   // critical structures of the case; empty: the file does not contain it
  std::vector<PivotRecord> pivots;         // in the order of their ends
  std::vector<casefile::Trajectory> plans; // of the case; empty: the file does not contain them
  std::vector<PathSample> path;
  std::optional<PathSummary> path_summary; // empty also if the plan is not known
  std::vector<Approach> approaches;        // one per structure, nearest first
  std::optional<InsertionAnalysis> insertion;
  std::vector<CheckRecord> checks;
  std::vector<AlarmChange> alarms;
  std::size_t critical_alarms = 0;         // raised
  std::size_t unacknowledged_critical = 0; // not acknowledged before they cleared or the session ended
  std::vector<StateSpan> states;
  // Counted since the first record, or since the daemon's start when that was at most five seconds earlier.
  std::vector<DeviceSummary> devices;
  std::vector<LoopSummary> loops;
  std::uint64_t unknown_device_samples = 0;
  std::uint64_t record_dropped = 0;

  surface::TriangleMesh scalp; // empty if the file has none
  std::vector<TracePoint> trace;

  [[nodiscard]] double seconds(std::int64_t time_ns) const { return static_cast<double>(time_ns - start_ns) * 1e-9; }
  [[nodiscard]] std::uint64_t rejected_in_all() const;
};

// An error when the file cannot be read completely, or is empty.
[[nodiscard]] base::Result<SessionAnalysis> analyse(const casefile::SessionReader &reader);

} // namespace bregma::cli::report
