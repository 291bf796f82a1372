#include "clients/gateway/layout.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include <nlohmann/json.hpp>

namespace bregma::gateway {
namespace {

template <class Member> constexpr FieldType type_of() {
  using Element = std::remove_all_extents_t<Member>;
  if constexpr (std::is_same_v<Element, double>) {
    return FieldType::kF64;
  } else if constexpr (std::is_same_v<Element, std::uint32_t>) {
    return FieldType::kU32;
  } else if constexpr (std::is_same_v<Element, std::int32_t>) {
    return FieldType::kI32;
  } else {
    static_assert(std::is_same_v<Element, char>);
    return FieldType::kChars;
  }
}

template <class Member> constexpr std::size_t count_of() { return std::is_array_v<Member> ? std::extent_v<Member> : 1; }

#define BREGMA_AT(Record, member, key, text)                                                                           \
  FieldLayout {                                                                                                        \
#member, type_of < decltype(Record::member)>(), offsetof(Record, member), count_of < decltype(Record::member)>(),  \
        key, text                                                                                                      \
  }
#define BREGMA_KEY(Record, member, text) BREGMA_AT(Record, member, true, text)
#define BREGMA_FIELD(Record, member, text) BREGMA_AT(Record, member, false, text)

constexpr FieldLayout kPongFields[] = {
    BREGMA_FIELD(Pong, client_ms, "time of the ping, as the client stated it"),
    BREGMA_FIELD(Pong, received_ms, "gateway clock when the ping arrived"),
    BREGMA_FIELD(Pong, written_ms, "gateway clock when this frame was written to the socket"),
};
constexpr FieldLayout kLinkFields[] = {
    BREGMA_FIELD(Link, silent_ms, "time since bregmad last spoke; NaN: never"),
    BREGMA_FIELD(Link, last_state_ms,
                 "publication of its latest NavigationState of any tool; NaN: none, or its age is not known"),
    BREGMA_FIELD(Link, presence, "0 no daemon has been heard, 1 silent: nothing of it is current, 2 alive"),
    BREGMA_FIELD(Link, changes, "times that another daemon was followed, because the one before was lost"),
    BREGMA_FIELD(Link, wire_generation, "of the daemon"),
    BREGMA_FIELD(Link, wire_revision, "of the daemon"),
    BREGMA_FIELD(Link, host, "of the daemon"),
    BREGMA_FIELD(Link, text, "what is wrong with the connection, for the operator; empty: nothing"),
};
constexpr FieldLayout kCaseFields[] = {
    BREGMA_FIELD(CaseProgress, fraction, "received, 0 to 1"),
    BREGMA_FIELD(CaseProgress, state,
                 "0 no case is loaded, 1 no case server answers, 2 on its way, 3 complete: fetch /case, "
                 "4 failed"),
    BREGMA_FIELD(CaseProgress, reserved, "0"),
    BREGMA_FIELD(CaseProgress, hash, "SHA-256 of the case in hexadecimal, as in /case/HASH/; zeros before state 3"),
    BREGMA_FIELD(CaseProgress, id, "of the case"),
    BREGMA_FIELD(CaseProgress, text, "why it failed, or what is awaited"),
};
constexpr FieldLayout kSessionFields[] = {
    BREGMA_FIELD(Session, session, "SessionState; 0 while the daemon is not alive"),
    BREGMA_FIELD(Session, reserved, "0"),
    BREGMA_FIELD(Session, time_ms, "when the daemon stated it"),
    BREGMA_FIELD(Session, next, "what to do next, for the operator; may be empty"),
};
constexpr FieldLayout kToolFields[] = {
    BREGMA_KEY(Tool, tool, "name"),
    BREGMA_FIELD(Tool, frame, "number of the tracker's frame"),
    BREGMA_FIELD(Tool, acquired_ms, "exposure of the pose; NaN: not known. Age on the glass: now minus this"),
    BREGMA_FIELD(Tool, published_ms, "publication by the daemon; NaN while its transit is not known"),
    BREGMA_FIELD(Tool, valid_until_ms,
                 "the pose must not be drawn from this time on; NaN: it must not be drawn at all"),
    BREGMA_FIELD(Tool, age_sigma_ms, "1-sigma uncertainty of the age; NaN: not stated"),
    BREGMA_FIELD(Tool, status,
                 "PoseStatus. Only POSE_LIVE (1) and POSE_UNVERIFIED (2) have a pose. A pose whose time was over "
                 "when the frame was written has POSE_STALE (3)"),
    BREGMA_FIELD(Tool, session, "SessionState"),
    BREGMA_FIELD(
        Tool, rotation,
        "of T_image_tip, row by row; this and all fields below are NaN without a pose, nearest_structure is empty"),
    BREGMA_FIELD(Tool, tip_mm, "tip in Image, at published_ms"),
    BREGMA_FIELD(Tool, velocity_mm_s, "of the tip"),
    BREGMA_FIELD(Tool, covariance,
                 "6x6 of T_image_tip at published_ms, row by row: rotation (rad), then translation (mm), left "
                 "perturbation in Image"),
    BREGMA_FIELD(
        Tool, position_velocity_covariance_mm2_s,
        "C. Growth of the position's covariance: P(dt) = P + dt (C + C^T) + dt^2 V + dt^4/4 a^2 I; NaN: none stated"),
    BREGMA_FIELD(Tool, velocity_covariance_mm2_s2, "V"),
    BREGMA_FIELD(Tool, acceleration_sigma_mm_s2, "a"),
    BREGMA_FIELD(Tool, tre_rms_mm, "predicted error of the tip at published_ms, RMS"),
    BREGMA_FIELD(Tool, tre_95_semi_axes_mm, "95 % ellipsoid of P, longest first"),
    BREGMA_FIELD(Tool, tre_95_axes, "row i: unit direction of semi-axis i"),
    BREGMA_FIELD(Tool, trajectory, "the plan, stated without a pose too; empty: none"),
    BREGMA_FIELD(Tool, distance_to_target_mm, "to the target as imaged"),
    BREGMA_FIELD(Tool, lateral_deviation_mm, "of the tip from the planned line"),
    BREGMA_FIELD(Tool, angle_rad, "between the tool's axis and the planned line"),
    BREGMA_FIELD(Tool, remaining_depth_mm, "along the planned line; negative beyond the target"),
    BREGMA_FIELD(Tool, predicted_target_mm, "target where the tissue model predicts it"),
    BREGMA_FIELD(Tool, distance_to_predicted_target_mm, "to that"),
    BREGMA_FIELD(Tool, nearest_structure, "name; empty: the case has none"),
    BREGMA_FIELD(Tool, nearest_structure_mm, "distance of the tip to its surface; 0 inside"),
    BREGMA_FIELD(Tool, prediction, "DeformationStatus"),
    BREGMA_FIELD(Tool, plausibility, "Plausibility; stated without a pose too, like the two below"),
    BREGMA_FIELD(Tool, plausibility_reason, "PlausibilityReason"),
    BREGMA_FIELD(Tool, source_kind, "DeviceKind"),
    BREGMA_FIELD(Tool, source, "device"),
    BREGMA_FIELD(
        Tool, nearest_structure_sigma_mm,
        "1-sigma error of that distance at published_ms; it contains the registration of the image in which the "
        "structure was segmented; 0: not stated"),
};
constexpr FieldLayout kRegistrationFields[] = {
    BREGMA_KEY(Registration, reference, "name"),
    BREGMA_FIELD(Registration, time_ms, "of the estimate"),
    BREGMA_FIELD(Registration, revision, "of the estimate"),
    BREGMA_FIELD(Registration, accepted_revision, "0: none is accepted"),
    BREGMA_FIELD(Registration, status, "RegistrationStatus"),
    BREGMA_FIELD(Registration, reason, "RefusalReason"),
    BREGMA_FIELD(Registration, subject, "what the reason is about"),
    BREGMA_FIELD(Registration, text, "for the operator"),
    BREGMA_FIELD(Registration, rotation, "of the estimate T_image_reference, row by row; NaN if it is refused"),
    BREGMA_FIELD(Registration, translation_mm, "of the estimate"),
    BREGMA_FIELD(Registration, accepted_rotation, "of the accepted T_image_reference; NaN: none"),
    BREGMA_FIELD(Registration, accepted_translation_mm, "of the accepted one"),
    BREGMA_FIELD(Registration, fiducials, "touched"),
    BREGMA_FIELD(Registration, surface_samples, "traced"),
    BREGMA_FIELD(Registration, fre_mm, "FRE: a consistency, never shown as an accuracy"),
    BREGMA_FIELD(Registration, fre_expected_mm, "expected from the stated errors"),
    BREGMA_FIELD(Registration, surface_rms_mm, "of the traced samples"),
};
constexpr FieldLayout kFiducialFields[] = {
    BREGMA_KEY(Fiducial, fiducial, "name"),
    BREGMA_FIELD(Fiducial, residual_mm, "in Image: registered minus planned"),
    BREGMA_FIELD(Fiducial, norm_mm, "of the residual"),
    BREGMA_FIELD(Fiducial, leave_one_out_mm, "distance if the fit excludes this fiducial; NaN below 4 fiducials"),
    BREGMA_FIELD(Fiducial, p_value, "probability of at least this residual for a correct fiducial"),
    BREGMA_FIELD(Fiducial, suspect, "1: it is"),
    BREGMA_FIELD(Fiducial, reserved, "0"),
};
constexpr FieldLayout kAccuracyFields[] = {
    BREGMA_KEY(Accuracy, reference, "name"),
    BREGMA_FIELD(Accuracy, time_ms, "of the statement"),
    BREGMA_FIELD(Accuracy, fre_mm, "FRE: a consistency"),
    BREGMA_FIELD(Accuracy, fre_expected_mm, "expected from the stated FLE"),
    BREGMA_FIELD(Accuracy, last_check_mm, "last check touch: distance of the displayed tip from the landmark"),
    BREGMA_FIELD(Accuracy, last_check_limit_mm, "95 % bound of that distance if nothing has moved"),
    BREGMA_FIELD(Accuracy, drift_statistic, "sequential test"),
    BREGMA_FIELD(Accuracy, drift_threshold, "0: no test yet"),
    BREGMA_FIELD(Accuracy, checks, "check touches"),
    BREGMA_FIELD(Accuracy, drift_detected, "1: it is"),
};
constexpr FieldLayout kTargetFields[] = {
    BREGMA_KEY(Target, target, "name"),
    BREGMA_FIELD(Target, tre_rms_mm, "predicted TRE of the accepted registration"),
    BREGMA_FIELD(Target, covariance_mm2, "row by row"),
    BREGMA_FIELD(Target, tre_95_semi_axes_mm, "longest first"),
    BREGMA_FIELD(Target, tre_95_axes, "row i: unit direction of semi-axis i"),
    BREGMA_FIELD(Target, image_rms_mm,
                 "part of tre_rms_mm: the registration of the image in which the target was placed; 0: the planning "
                 "image, or not stated"),
};
constexpr FieldLayout kDeformationFields[] = {
    BREGMA_KEY(Deformation, point, "name of the target or brain landmark"),
    BREGMA_FIELD(Deformation, time_ms, "of the statement"),
    BREGMA_FIELD(Deformation, kind, "FollowedKind"),
    BREGMA_FIELD(Deformation, status, "DeformationStatus; DEFORMATION_UNKNOWN (0) when it is no longer current"),
    BREGMA_FIELD(Deformation, reason, "DeformationReason"),
    BREGMA_FIELD(Deformation, phase, "ProbePhase; this and the fields from tip_force_N on describe the whole model"),
    BREGMA_FIELD(Deformation, imaged_mm, "position in the image"),
    BREGMA_FIELD(Deformation, displaced_mm, "predicted position; NaN unless VALID or EXTRAPOLATING"),
    BREGMA_FIELD(Deformation, error_bound_mm, "of that prediction"),
    BREGMA_FIELD(Deformation, von_mises_Pa, "at the point"),
    BREGMA_FIELD(Deformation, tip_force_N, "of the tip on the tissue, along the shaft"),
    BREGMA_FIELD(Deformation, shaft_force_N, "friction along the shaft"),
    BREGMA_FIELD(Deformation, measured_force_N, "along the shaft; NaN without a live sensor"),
    BREGMA_FIELD(Deformation, depth_mm, "of the shaft in the tissue; before the rupture depth of the indentation"),
    BREGMA_FIELD(Deformation, rupture_force_N, "tip force at the last rupture"),
    BREGMA_FIELD(Deformation, stiffness_scale, "ratio of measured and modelled force"),
    BREGMA_FIELD(Deformation, behind_ms, "elapsed time that the step did not simulate"),
    BREGMA_FIELD(Deformation, ruptures, "number"),
    BREGMA_FIELD(Deformation, elements, "tetrahedra of the model"),
};
constexpr FieldLayout kFieldFields[] = {
    BREGMA_KEY(FieldHeader, model, "name"),
    BREGMA_FIELD(FieldHeader, time_ms, "of the statement"),
    BREGMA_FIELD(FieldHeader, status, "DeformationStatus"),
    BREGMA_FIELD(FieldHeader, nodes, "n, in the order of the vertices of the mesh `tissue` in /case"),
    BREGMA_FIELD(FieldHeader, stresses, "n, or 0: not stated"),
    BREGMA_FIELD(FieldHeader, reserved, "0"),
};
constexpr FieldLayout kCaptureFields[] = {
    BREGMA_KEY(Capture, tool, "name"),
    BREGMA_KEY(Capture, ordinal, "0, 1, ... in the order of capture. `ended` removes this point"),
    BREGMA_FIELD(Capture, acquired_ms, "exposure"),
    BREGMA_FIELD(Capture, frame, "number of the tracker's frame"),
    BREGMA_FIELD(Capture, kind, "CaptureKind"),
    BREGMA_FIELD(Capture, reserved, "0"),
    BREGMA_FIELD(Capture, point, "fiducial or landmark; empty for surface samples"),
    BREGMA_FIELD(Capture, position_mm,
                 "of the tip, in Reference (T_image_reference of the registration leads to Image)"),
    BREGMA_FIELD(Capture, covariance_mm2, "in Reference, row by row"),
};
constexpr FieldLayout kAlarmFields[] = {
    BREGMA_KEY(Alarm, alarm, "kind, such as drift or tracker_lost"),
    BREGMA_KEY(Alarm, subject, "affected device, tool or target; may be empty"),
    BREGMA_FIELD(Alarm, raised_ms, "when"),
    BREGMA_FIELD(Alarm, changed_ms, "when"),
    BREGMA_FIELD(Alarm, state, "AlarmState; a cleared alarm ends"),
    BREGMA_FIELD(Alarm, severity, "AlarmSeverity"),
    BREGMA_FIELD(Alarm, count, "times that it was raised in this session"),
    BREGMA_FIELD(Alarm, reserved, "0"),
    BREGMA_FIELD(Alarm, text, "for the operator"),
};
constexpr FieldLayout kDeviceFields[] = {
    BREGMA_KEY(Device, device, "name"),
    BREGMA_FIELD(Device, kind, "DeviceKind"),
    BREGMA_FIELD(Device, status, "DeviceStatus"),
    BREGMA_FIELD(Device, taken, "accepted samples"),
    BREGMA_FIELD(Device, rejected, "samples, for all reasons"),
    BREGMA_FIELD(Device, lost, "gaps in the frame numbers"),
    BREGMA_FIELD(Device, late, "samples"),
    BREGMA_FIELD(Device, connections, "1 at first"),
    BREGMA_FIELD(Device, rate_hz, "measured"),
    BREGMA_FIELD(Device, stated_rate_hz, "by the device; 0: not stated"),
    BREGMA_FIELD(Device, age_ms, "of the latest sample, when the daemon stated it"),
    BREGMA_FIELD(Device, age_sigma_ms, "0: not stated"),
    BREGMA_FIELD(Device, latency_p50_ms, "exposure to arrival at the daemon"),
    BREGMA_FIELD(Device, latency_p99_ms, "the same"),
    BREGMA_FIELD(Device, clock_offset_ms, "host minus device"),
    BREGMA_FIELD(Device, clock_drift_ppm, "of the device's clock"),
    BREGMA_FIELD(Device, driver_state, "DriverState of its driver; 0: not stated"),
    BREGMA_FIELD(Device, reserved, "0"),
    BREGMA_FIELD(Device, volume_near_mm,
                 "working volume of a tracker, a frustum about its z axis: smallest depth; NaN: not stated, like the "
                 "three below"),
    BREGMA_FIELD(Device, volume_far_mm, "largest depth"),
    BREGMA_FIELD(Device, volume_half_width_rad, "half of its angle along x"),
    BREGMA_FIELD(Device, volume_half_height_rad, "half of its angle along y"),
};
constexpr FieldLayout kLoopFields[] = {
    BREGMA_KEY(Loop, loop, "name"),
    BREGMA_FIELD(Loop, rate_hz, "0: event driven"),
    BREGMA_FIELD(Loop, steps, "number"),
    BREGMA_FIELD(Loop, overruns, "number"),
    BREGMA_FIELD(Loop, step_p50_us, "duration"),
    BREGMA_FIELD(Loop, step_p99_us, "duration"),
    BREGMA_FIELD(Loop, step_max_us, "duration"),
};
constexpr FieldLayout kHealthFields[] = {
    BREGMA_FIELD(Health, time_ms, "of the statement"),
    BREGMA_FIELD(Health, started_ms, "start of the daemon"),
    BREGMA_FIELD(Health, recorded, "samples"),
    BREGMA_FIELD(Health, record_dropped, "samples that the recorder lost"),
    BREGMA_FIELD(Health, resident_bytes, "memory of the daemon"),
    BREGMA_FIELD(Health, clock_error_ms, "maximal error of its wall clock; NaN: not synchronised"),
    BREGMA_FIELD(Health, recorder_failing, "1: it is"),
    BREGMA_FIELD(Health, clock_steps, "steps of the daemon's wall clock"),
    BREGMA_FIELD(Health, other_wire, "participants with another wire generation"),
    BREGMA_FIELD(Health, reserved, "0"),
};
constexpr FieldLayout kTrackedToolFields[] = {
    BREGMA_KEY(TrackedTool, device, "tracker"),
    BREGMA_KEY(TrackedTool, tool, "name"),
    BREGMA_FIELD(TrackedTool, frame, "number"),
    BREGMA_FIELD(TrackedTool, acquired_ms, "arrival at the gateway"),
    BREGMA_FIELD(TrackedTool, status, "ToolStatus; TOOL_UNKNOWN (0) if the tracker has been silent for 0.5 s"),
    BREGMA_FIELD(TrackedTool, used_markers, "bit i: the fit used marker i of the tool in /case"),
    BREGMA_FIELD(TrackedTool, rotation, "of T_tracker_tool, row by row; NaN unless visible"),
    BREGMA_FIELD(TrackedTool, translation_mm, "of T_tracker_tool"),
    BREGMA_FIELD(TrackedTool, marker_rms_mm, "residual of the fit; NaN unless visible"),
};
constexpr FieldLayout kSliceFields[] = {
    BREGMA_KEY(SliceHeader, device, "scanner"),
    BREGMA_FIELD(SliceHeader, published_ms, "publication by the daemon; NaN: not known. The tip is that of this time"),
    BREGMA_FIELD(SliceHeader, number, "counts the scanner's slices"),
    BREGMA_FIELD(SliceHeader, columns, "pixels of a row"),
    BREGMA_FIELD(SliceHeader, rows, "number"),
    BREGMA_FIELD(SliceHeader, spacing_mm, "between columns, between rows"),
    BREGMA_FIELD(SliceHeader, thickness_mm, "0: not stated"),
    BREGMA_FIELD(
        SliceHeader, rotation,
        "of T_scanner_slice, row by row. Slice: x along a row, y along a column, from the first pixel's centre"),
    BREGMA_FIELD(SliceHeader, translation_mm, "of T_scanner_slice"),
    BREGMA_FIELD(SliceHeader, image_rotation,
                 "of T_image_slice; NaN: the scanner is not registered to the case's image"),
    BREGMA_FIELD(SliceHeader, image_translation_mm, "of T_image_slice"),
    BREGMA_FIELD(SliceHeader, protocol, "of the series; may be empty"),
    BREGMA_FIELD(SliceHeader, series, "number"),
    BREGMA_FIELD(SliceHeader, index, "of the slice in its series, from 1"),
    BREGMA_FIELD(SliceHeader, count, "slices of the series"),
    BREGMA_FIELD(SliceHeader, correction, "DistortionCorrection of the pixels"),
    BREGMA_FIELD(SliceHeader, max_shift_mm, "largest correction of a pixel"),
    BREGMA_FIELD(SliceHeader, error_95_mm, "of the correction; 0: not stated"),
    BREGMA_FIELD(SliceHeader, extrapolated_fraction, "fraction of the pixels outside the volume of the phantom"),
    BREGMA_FIELD(SliceHeader, missing_fraction, "fraction of the pixels whose neighbouring slices were missing"),
    BREGMA_FIELD(SliceHeader, tip_status,
                 "PoseStatus of the robot's tip; the fields below are NaN unless POSE_LIVE (1)"),
    BREGMA_FIELD(SliceHeader, reserved, "0"),
    BREGMA_FIELD(SliceHeader, tip_tool, "tool of the robot"),
    BREGMA_FIELD(SliceHeader, tip_pixel, "column and row of the point of the plane that is nearest to the tip"),
    BREGMA_FIELD(SliceHeader, tip_distance_mm, "from the plane, positive along its normal"),
    BREGMA_FIELD(SliceHeader, tip_direction, "unit vector from the flange to the tip, in the slice"),
    BREGMA_FIELD(SliceHeader, tip_error_95_mm, "of the tip in the scanner"),
};
constexpr FieldLayout kScannerFields[] = {
    BREGMA_KEY(Scanner, device, "scanner"),
    BREGMA_FIELD(Scanner, time_ms, "when the daemon stated it"),
    BREGMA_FIELD(Scanner, step, "ScannerStep"),
    BREGMA_FIELD(Scanner, activity, "ScannerActivity; 0 while the daemon is not alive"),
    BREGMA_FIELD(Scanner, text, "the state, for the operator"),
    BREGMA_FIELD(Scanner, next, "what to do next; empty while the daemon is not alive"),
    BREGMA_FIELD(Scanner, protocol, "of the series under way; empty: none"),
    BREGMA_FIELD(Scanner, slices, "received of the series under way"),
    BREGMA_FIELD(Scanner, slices_expected, "of the series under way"),
    BREGMA_FIELD(Scanner, slices_taken, "since the start of the daemon"),
    BREGMA_FIELD(Scanner, slices_refused, "since the start of the daemon"),
    BREGMA_FIELD(Scanner, slices_corrected, "since the start of the daemon"),
    BREGMA_FIELD(Scanner, refused_text, "why the last slice was refused; may be empty"),
    BREGMA_FIELD(Scanner, revision, "counts estimates; 0: none"),
    BREGMA_FIELD(Scanner, verdict, "ScannerVerdict of the latest estimate"),
    BREGMA_FIELD(Scanner, validity, "ScannerValidity of the accepted registration; 0 while the daemon is not alive"),
    BREGMA_FIELD(Scanner, reason, "of the verdict, or the first note"),
    BREGMA_FIELD(Scanner, fre_mm, "of the latest estimate: a consistency, not an accuracy"),
    BREGMA_FIELD(Scanner, fre_expected_mm, "by the stated errors"),
    BREGMA_FIELD(Scanner, tre_95_mm, "predicted at the target"),
    BREGMA_FIELD(Scanner, verified_mm, "at the coils that verify, the error of finding them included"),
    BREGMA_FIELD(Scanner, opme_mm, "mean error out of the plane of the slices"),
    BREGMA_FIELD(Scanner, change_mm, "at the target, relative to the accepted registration"),
    BREGMA_FIELD(Scanner, change_rad, "relative to the accepted registration"),
    BREGMA_FIELD(Scanner, validity_text, "why the accepted registration is not valid"),
    BREGMA_FIELD(Scanner, accepted_revision, "0: none is accepted"),
    BREGMA_FIELD(Scanner, accepted_ms, "when it was accepted"),
    BREGMA_FIELD(Scanner, accepted_tre_95_mm, "predicted at the target, after verification"),
    BREGMA_FIELD(Scanner, accepted_rotation, "of T_base_scanner, row by row; NaN unless validity is SCANNER_VALID"),
    BREGMA_FIELD(Scanner, accepted_translation_mm, "of T_base_scanner"),
    BREGMA_FIELD(Scanner, accepted_corrected, "1: with a distortion field"),
    BREGMA_FIELD(Scanner, field_status, "FieldStatus of the distortion field"),
    BREGMA_FIELD(Scanner, field, "its identity; empty: none"),
    BREGMA_FIELD(Scanner, field_made_ms, "when it was made"),
    BREGMA_FIELD(Scanner, field_expires_ms, "NaN: never"),
    BREGMA_FIELD(Scanner, field_points, "control points; 0: not stated"),
    BREGMA_FIELD(Scanner, field_initial_mm, "mean distortion of the phantom"),
    BREGMA_FIELD(Scanner, field_residual_mm, "mean at points held out"),
    BREGMA_FIELD(Scanner, field_residual_max_mm, "largest at points held out"),
    BREGMA_FIELD(Scanner, phantom_moved_mm, "between the scans of the phantom"),
};
constexpr FieldLayout kScannerCoilFields[] = {
    BREGMA_KEY(ScannerCoil, device, "scanner"),
    BREGMA_KEY(ScannerCoil, coil, "of the registration frame"),
    BREGMA_FIELD(ScannerCoil, outcome, "CoilOutcome"),
    BREGMA_FIELD(ScannerCoil, reserved, "0"),
    BREGMA_FIELD(ScannerCoil, scanner_mm, "place in the scanner, corrected"),
    BREGMA_FIELD(ScannerCoil, sigma_mm, "of one coordinate"),
    BREGMA_FIELD(ScannerCoil, residual_mm, "in the robot's base, after the fit"),
};
constexpr FieldLayout kRobotToolFields[] = {
    BREGMA_KEY(RobotTool, device, "arm"),
    BREGMA_FIELD(RobotTool, tool, "it carries; empty: none"),
    BREGMA_FIELD(RobotTool, frame, "number of the arm's state"),
    BREGMA_FIELD(RobotTool, acquired_ms, "time of the pose; NaN: not known"),
    BREGMA_FIELD(RobotTool, published_ms, "publication by the daemon; NaN while its transit is not known"),
    BREGMA_FIELD(RobotTool, valid_until_ms,
                 "the poses must not be drawn from this time on; NaN: they must not be drawn at all"),
    BREGMA_FIELD(RobotTool, mode, "RobotMode"),
    BREGMA_FIELD(RobotTool, status,
                 "PoseStatus in the robot's base. A pose whose time was over when the frame was written has "
                 "POSE_STALE (3)"),
    BREGMA_FIELD(RobotTool, rotation, "of T_base_tip, row by row; NaN unless POSE_LIVE (1)"),
    BREGMA_FIELD(RobotTool, tip_mm, "tip in the robot's base"),
    BREGMA_FIELD(RobotTool, covariance, "6x6 of T_base_tip, rotation first, left perturbation in the base"),
    BREGMA_FIELD(RobotTool, scanner_status, "PoseStatus in the scanner"),
    BREGMA_FIELD(RobotTool, reserved, "0"),
    BREGMA_FIELD(RobotTool, scanner, "to which the base is registered; empty: none"),
    BREGMA_FIELD(RobotTool, scanner_rotation, "of T_scanner_tip, row by row; NaN unless scanner_status is POSE_LIVE"),
    BREGMA_FIELD(RobotTool, scanner_tip_mm, "tip in the scanner"),
    BREGMA_FIELD(RobotTool, scanner_covariance, "6x6 of T_scanner_tip"),
    BREGMA_FIELD(RobotTool, scanner_error_95_mm, "of the tip in the scanner"),
};
#undef BREGMA_FIELD
#undef BREGMA_KEY
#undef BREGMA_AT

constexpr RecordLayout kRecords[] = {
    {RecordKind::kPong, "pong", sizeof(Pong), "answer to a ping", kPongFields},
    {RecordKind::kLink, "link", sizeof(Link),
     "the gateway's connection to the daemon; at least four times per second, so a frame without delay is the socket's "
     "sign of life",
     kLinkFields},
    {RecordKind::kCase, "case", sizeof(CaseProgress), "the loaded case, on its way to the gateway", kCaseFields},
    {RecordKind::kSession, "session", sizeof(Session), "state of the session", kSessionFields},
    {RecordKind::kTool, "tool", sizeof(Tool), "`NavigationState`, one per tool", kToolFields},
    {RecordKind::kRegistration, "registration", sizeof(Registration), "`RegistrationState`", kRegistrationFields},
    {RecordKind::kFiducial, "fiducial", sizeof(Fiducial), "`FiducialReport`, one per fiducial", kFiducialFields},
    {RecordKind::kAccuracy, "accuracy", sizeof(Accuracy), "`AccuracyState`", kAccuracyFields},
    {RecordKind::kTarget, "target", sizeof(Target), "`AccuracyState`, one per target", kTargetFields},
    {RecordKind::kDeformation, "deformation", sizeof(Deformation), "`DeformationState`, one per followed point",
     kDeformationFields},
    {RecordKind::kField, "field", sizeof(FieldHeader),
     "`DeformationField`, at most 5 per second, only for clients that asked for it. After the fields: n x 3 float32 "
     "displacement_mm, then the stresses as float32, von_mises_Pa, then zeros up to a multiple of 8 bytes",
     kFieldFields},
    {RecordKind::kCapture, "capture", sizeof(Capture), "`CapturedPoint`, one per captured point", kCaptureFields},
    {RecordKind::kAlarm, "alarm", sizeof(Alarm), "`Alarm`, one per alarm that is not cleared", kAlarmFields},
    {RecordKind::kDevice, "device", sizeof(Device), "`SystemHealth`, one per device", kDeviceFields},
    {RecordKind::kLoop, "loop", sizeof(Loop), "`SystemHealth`, one per loop", kLoopFields},
    {RecordKind::kHealth, "health", sizeof(Health), "`SystemHealth`", kHealthFields},
    {RecordKind::kTrackedTool, "tracked_tool", sizeof(TrackedTool),
     "`TrackerFrame`, one per tracker and tool, at most 10 per second", kTrackedToolFields},
    {RecordKind::kSlice, "slice", sizeof(SliceHeader),
     "`CorrectedSlice`, one per scanner, only for clients that asked for it. After the fields: columns x rows u16, row "
     "by "
     "row, then zeros up to a multiple of 8 bytes",
     kSliceFields},
    {RecordKind::kScanner, "scanner", sizeof(Scanner), "`ScannerRegistration`, one per scanner", kScannerFields},
    {RecordKind::kScannerCoil, "scanner_coil", sizeof(ScannerCoil),
     "`ScannerRegistration`, one per coil of the registration frame", kScannerCoilFields},
    {RecordKind::kRobotTool, "robot_tool", sizeof(RobotTool), "`RobotTool`, one per arm", kRobotToolFields},
};

constexpr std::size_t size_of(FieldType type) {
  return type == FieldType::kF64 ? 8 : type == FieldType::kChars ? 1 : 4;
}

// Every byte of every record belongs to a field, doubles are aligned, and kinds are numbered in order.
constexpr bool complete() {
  std::uint16_t kind = 1;
  for (const RecordLayout &record : kRecords) {
    std::size_t at = 0;
    for (const FieldLayout &field : record.fields) {
      if (field.offset != at || (field.type == FieldType::kF64 && at % 8 != 0)) {
        return false;
      }
      at += field.count * size_of(field.type);
    }
    if (at != record.bytes || at % 8 != 0 || static_cast<std::uint16_t>(record.kind) != kind++) {
      return false;
    }
  }
  return true;
}
static_assert(complete());
static_assert(sizeof(FrameHeader) == 24 && sizeof(RecordHeader) == 8 && sizeof(Request) == 16);

template <class T> T read(const std::byte *at) {
  T out;
  std::memcpy(&out, at, sizeof out);
  return out;
}

nlohmann::json number(double value) { return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(); }

nlohmann::json element(const FieldLayout &field, const std::byte *at) {
  switch (field.type) {
  case FieldType::kF64:
    return number(read<double>(at));
  case FieldType::kU32:
    return read<std::uint32_t>(at);
  case FieldType::kI32:
    return read<std::int32_t>(at);
  case FieldType::kChars:
    break;
  }
  const auto *text = reinterpret_cast<const char *>(at);
  return std::string(text, std::find(text, text + field.count, '\0'));
}

nlohmann::json field_json(const FieldLayout &field, const std::byte *body) {
  const std::byte *at = body + field.offset;
  if (field.type == FieldType::kChars || field.count == 1) {
    return element(field, at);
  }
  nlohmann::json out = nlohmann::json::array();
  for (std::size_t i = 0; i < field.count; ++i) {
    out.push_back(element(field, at + i * size_of(field.type)));
  }
  return out;
}

nlohmann::json floats(const std::byte *at, std::size_t count) {
  nlohmann::json out = nlohmann::json::array();
  for (std::size_t i = 0; i < count; ++i) {
    out.push_back(number(static_cast<double>(read<float>(at + i * sizeof(float)))));
  }
  return out;
}

std::string type_text(const FieldLayout &field) {
  if (field.type == FieldType::kChars) {
    return "char[" + std::to_string(field.count) + "]";
  }
  const std::string name = field.type == FieldType::kF64 ? "f64" : field.type == FieldType::kU32 ? "u32" : "i32";
  return field.count == 1 ? name : name + "[" + std::to_string(field.count) + "]";
}

} // namespace

std::span<const RecordLayout> record_layouts() { return kRecords; }

const RecordLayout *find_layout(std::uint16_t kind) {
  return kind >= 1 && kind <= std::size(kRecords) ? &kRecords[kind - 1] : nullptr;
}

nlohmann::json record_json(std::span<const std::byte> record) {
  const auto header = read<RecordHeader>(record.data());
  const RecordLayout *layout = find_layout(header.kind);
  nlohmann::json out{{"kind", layout->name}};
  const bool ended = (header.flags & kEnded) != 0;
  if (ended) {
    out["ended"] = true;
  }
  const std::byte *body = record.data() + sizeof(RecordHeader);
  for (const FieldLayout &field : layout->fields) {
    // Records name their own kind of thing "kind" too; in JSON that word is taken by the record's.
    const std::string name = field.name == "kind" ? std::string(layout->name) + "_kind" : std::string(field.name);
    if (field.name != "reserved" && (!ended || field.key)) {
      out[name] = field_json(field, body);
    }
  }
  if (layout->kind == RecordKind::kField && !ended) {
    const auto field = read<FieldHeader>(body);
    out["displacement_mm"] = floats(body + sizeof(FieldHeader), std::size_t{3} * field.nodes);
    out["von_mises_Pa"] = floats(body + sizeof(FieldHeader) + std::size_t{12} * field.nodes, field.stresses);
  }
  if (layout->kind == RecordKind::kSlice && !ended) {
    const auto slice = read<SliceHeader>(body);
    nlohmann::json pixels = nlohmann::json::array();
    for (std::size_t i = 0; i < std::size_t{slice.columns} * slice.rows; ++i) {
      pixels.push_back(read<std::uint16_t>(body + sizeof(SliceHeader) + i * sizeof(std::uint16_t)));
    }
    out["pixels"] = std::move(pixels);
  }
  return out;
}

nlohmann::json frame_json(std::span<const std::byte> frame) {
  const auto header = read<FrameHeader>(frame.data());
  nlohmann::json records = nlohmann::json::array();
  std::size_t at = sizeof(FrameHeader);
  for (int i = 0; i < header.records; ++i) {
    const auto record = read<RecordHeader>(frame.data() + at);
    records.push_back(record_json(frame.subspan(at, record.bytes)));
    at += record.bytes;
  }
  return {{"frame", header.frame}, {"written_ms", header.written_ms}, {"records", std::move(records)}};
}

std::string layout_markdown() {
  std::string out;
  for (const RecordLayout &record : kRecords) {
    out += "### " + std::to_string(static_cast<int>(record.kind)) + " " + std::string(record.name) + "\n\n";
    out += std::string(record.text) + ". " + std::to_string(sizeof(RecordHeader) + record.bytes) + " bytes" +
           (record.kind == RecordKind::kField || record.kind == RecordKind::kSlice ? " and the arrays" : "") + ".\n\n";
    out += "| offset | type | field | |\n| --- | --- | --- | --- |\n";
    for (const FieldLayout &field : record.fields) {
      out += "| " + std::to_string(sizeof(RecordHeader) + field.offset) + " | " + type_text(field) + " | " +
             (field.key ? "**" : "") + std::string(field.name) + (field.key ? "**" : "") + " | " +
             std::string(field.text) + " |\n";
    }
    out += "\n";
  }
  return out;
}

} // namespace bregma::gateway
