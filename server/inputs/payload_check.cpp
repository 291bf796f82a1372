#include "server/inputs/payload_check.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <iterator>

#include "idl/names.hpp"

namespace bregma::inputs {
namespace {

using wire::RejectReason;

// No constant of the wire is negative. An unknown positive value belongs to a later revision.
bool is_constant(std::int32_t value) noexcept { return value >= 0; }

bool is_name(const wire::Name &name) noexcept { return name[0] != '\0' && wire::is_terminated(name); }

template <std::size_t N> bool is_ended(const char (&text)[N]) noexcept { return strnlen(text, N) < N; }

bool are_finite(std::span<const double> values) noexcept {
  for (const double value : values) {
    if (!std::isfinite(value)) {
      return false;
    }
  }
  return true;
}

Rejection check_pose(const wire::Pose &pose) noexcept {
  if (!are_finite(pose.rotation_wxyz) || !are_finite(pose.translation_mm)) {
    return bregma_wire_REJECT_NOT_FINITE;
  }
  const auto &q = pose.rotation_wxyz;
  const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(std::abs(norm - 1.0) <= kRotationTolerance)) {
    return bregma_wire_REJECT_NOT_A_ROTATION;
  }
  for (const double coordinate : pose.translation_mm) {
    if (std::abs(coordinate) > kMaxPosition_mm) {
      return bregma_wire_REJECT_MALFORMED;
    }
  }
  return std::nullopt;
}

// A stated covariance must be finite, with non-negative variances and correlations of at most 1. All 0: not stated.
Rejection check_covariance(const wire::PoseCovariance &upper) noexcept {
  for (const float entry : upper) {
    if (!std::isfinite(entry)) {
      return bregma_wire_REJECT_NOT_FINITE;
    }
  }
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = row; column < 6; ++column) {
      const double entry = upper[wire::upper_index(row, column)];
      const double variances = double{upper[wire::upper_index(row, row)]} * upper[wire::upper_index(column, column)];
      const bool negative = row == column && entry < 0.0;
      if (negative || entry * entry > variances * kCorrelationTolerance) {
        return bregma_wire_REJECT_MALFORMED;
      }
    }
  }
  return std::nullopt;
}

bool is_tracked(const wire::TrackedTool &tool) noexcept {
  return tool.status == bregma_wire_TOOL_VISIBLE || tool.status == bregma_wire_TOOL_PARTLY_VISIBLE;
}

bool is_well_formed(const wire::TrackerFrame &sample) noexcept {
  if (sample.tool_count > bregma_wire_MAX_TOOLS) {
    return false;
  }
  for (std::uint32_t i = 0; i < sample.tool_count; ++i) {
    const wire::TrackedTool &tool = sample.tools[i];
    if (!is_name(tool.tool) || !is_constant(tool.status)) {
      return false;
    }
    for (std::uint32_t j = 0; j < i; ++j) {
      if (wire::view(sample.tools[j].tool) == wire::view(tool.tool)) {
        return false;
      }
    }
  }
  return true;
}

} // namespace

bool KnownTools::contains(std::string_view name) const noexcept {
  for (std::uint32_t i = 0; i < count; ++i) {
    if (wire::view(names[i]) == name) {
      return true;
    }
  }
  return any;
}

std::optional<KnownTools> known_tools(std::span<const std::string> names) {
  KnownTools tools;
  tools.any = false;
  if (names.size() > bregma_wire_MAX_TOOLS) {
    return std::nullopt;
  }
  for (const std::string &name : names) {
    if (!wire::set_name(tools.names[tools.count++], name)) {
      return std::nullopt;
    }
  }
  return tools;
}

Rejection check_payload(const wire::TrackerFrame &sample, const KnownTools &tools) noexcept {
  if (!is_well_formed(sample)) {
    return bregma_wire_REJECT_MALFORMED;
  }
  for (std::uint32_t i = 0; i < sample.tool_count; ++i) {
    const wire::TrackedTool &tool = sample.tools[i];
    if (!is_tracked(tool) || !tools.contains(wire::view(tool.tool))) {
      continue;
    }
    if (tool.marker_rms_mm < 0.0) {
      return bregma_wire_REJECT_MALFORMED;
    }
    if (!std::isfinite(tool.marker_rms_mm)) {
      return bregma_wire_REJECT_NOT_FINITE;
    }
    if (const Rejection rejection = check_pose(tool.T_tracker_tool)) {
      return rejection;
    }
    if (const Rejection rejection = check_covariance(tool.covariance)) {
      return rejection;
    }
  }
  return std::nullopt;
}

Rejection check_payload(const wire::RobotState &sample, const KnownTools & /*tools*/) noexcept {
  if (sample.joint_count > bregma_wire_MAX_JOINTS || !is_constant(sample.mode) || !wire::is_terminated(sample.tool) ||
      !wire::is_terminated(sample.motion_client)) {
    return bregma_wire_REJECT_MALFORMED;
  }
  const std::size_t joints = sample.joint_count;
  if (!are_finite(std::span(sample.joint_position_rad).first(joints)) ||
      !are_finite(std::span(sample.joint_velocity_rad_s).first(joints)) ||
      !are_finite(std::span(sample.joint_effort_Nm).first(joints))) {
    return bregma_wire_REJECT_NOT_FINITE;
  }
  const Rejection pose = check_pose(sample.T_base_flange);
  return pose ? pose : check_covariance(sample.covariance);
}

Rejection check_payload(const wire::RobotMotionState &sample, const KnownTools & /*tools*/) noexcept {
  if (sample.joint_count > bregma_wire_MAX_JOINTS || !is_constant(sample.operating_state) ||
      !is_constant(sample.phase) || !is_constant(sample.cause) || !wire::is_terminated(sample.motion_client) ||
      !is_ended(sample.text) || sample.waypoint_count > bregma_wire_MAX_WAYPOINTS ||
      sample.waypoint > sample.waypoint_count) {
    return bregma_wire_REJECT_MALFORMED;
  }
  if (!are_finite(std::span(sample.setpoint_jp_rad).first(sample.joint_count))) {
    return bregma_wire_REJECT_NOT_FINITE;
  }
  // NaN: not stated.
  if (sample.deadman_age_ms < 0.0 || sample.stop_distance_mm < 0.0 || std::isinf(sample.deadman_age_ms) ||
      std::isinf(sample.stop_distance_mm)) {
    return bregma_wire_REJECT_MALFORMED;
  }
  return std::nullopt;
}

Rejection check_payload(const wire::RangeSample &sample, const KnownTools & /*tools*/) noexcept {
  if (sample.status == bregma_wire_RANGE_UNKNOWN || !is_constant(sample.status)) {
    return bregma_wire_REJECT_MALFORMED;
  }
  if (sample.status != bregma_wire_RANGE_VALID) {
    return std::nullopt; // no reading: its values are not checked
  }
  if (!std::isfinite(sample.range_mm) || !std::isfinite(sample.sigma_mm)) {
    return bregma_wire_REJECT_NOT_FINITE;
  }
  return sample.range_mm < 0.0 || sample.sigma_mm < 0.0 ? Rejection(bregma_wire_REJECT_MALFORMED) : std::nullopt;
}

Rejection check_payload(const wire::ForceSample &sample, const KnownTools & /*tools*/) noexcept {
  const bool finite = are_finite(sample.force_N) && are_finite(sample.torque_Nmm);
  return finite ? std::nullopt : Rejection(bregma_wire_REJECT_NOT_FINITE);
}

MarkerFault check_markers(const wire::TrackedTool &tool, std::size_t markers) noexcept {
  if (markers == 0) {
    const bool stated =
        std::any_of(std::begin(tool.covariance), std::end(tool.covariance), [](float entry) { return entry != 0.0F; });
    return stated ? MarkerFault::kNone : MarkerFault::kNoCovariance;
  }
  const std::uint64_t all = (std::uint64_t{1} << std::min<std::size_t>(markers, 32)) - 1;
  if ((tool.used_markers & ~all) != 0) {
    return MarkerFault::kForeign;
  }
  if (std::popcount(tool.used_markers) < 3) {
    return MarkerFault::kTooFew;
  }
  const bool has_all = tool.used_markers == all;
  if (has_all != (tool.status == bregma_wire_TOOL_VISIBLE)) {
    return has_all ? MarkerFault::kAll : MarkerFault::kNotAll;
  }
  return MarkerFault::kNone;
}

std::string_view describe(MarkerFault fault) noexcept {
  switch (fault) {
  case MarkerFault::kTooFew:
    return "fewer than three markers that determine a pose";
  case MarkerFault::kForeign:
    return "markers that the tool does not have";
  case MarkerFault::kNotAll:
    return "status visible, but not every marker";
  case MarkerFault::kAll:
    return "status partly visible, but every marker";
  case MarkerFault::kNoCovariance:
    return "neither markers nor a covariance";
  case MarkerFault::kNone:
    break;
  }
  return "no fault";
}

std::string_view describe(RejectReason reason) noexcept {
  switch (reason) {
  case bregma_wire_REJECT_NOT_FINITE:
    return "not finite";
  case bregma_wire_REJECT_NOT_A_ROTATION:
    return "not a rotation";
  case bregma_wire_REJECT_TIME_BACKWARDS:
    return "time backwards";
  case bregma_wire_REJECT_TIME_IN_FUTURE:
    return "time in the future";
  case bregma_wire_REJECT_UNKNOWN_DEVICE:
    return "unknown device";
  case bregma_wire_REJECT_UNKNOWN_TOOL:
    return "unknown tool";
  case bregma_wire_REJECT_DUPLICATE:
    return "duplicate";
  case bregma_wire_REJECT_MALFORMED:
    return "malformed";
  default:
    return "unknown reason";
  }
}

} // namespace bregma::inputs
