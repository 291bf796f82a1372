#include "tests/faults/tamper.hpp"

#include <algorithm>
#include <cstring>
#include <span>

#include "algorithms/geometry/unknown.hpp"
#include "idl/names.hpp"

namespace bregma::faults {
namespace {

constexpr double kJump_mm = 100.0;
constexpr double kBent_mm = 4.0;     // error of a pose that is fitted to a bent marker
constexpr double kBent_rms_mm = 2.0; // its residual; the markers' own errors give 0.3
constexpr std::int64_t kRestartedClock_ns = 1'000'000'000'000;
constexpr const char *kReference = "Reference";

std::span<wire::TrackedTool> tools_of(wire::TrackerFrame &frame) { return {frame.tools, frame.tool_count}; }

wire::TrackedTool *find(wire::TrackerFrame &frame, std::string_view name) {
  const auto tools = tools_of(frame);
  const auto found =
      std::find_if(tools.begin(), tools.end(), [&](const auto &tool) { return wire::view(tool.tool) == name; });
  return found != tools.end() ? &*found : nullptr;
}

void fill(wire::Name &name) { std::memset(name, 'x', sizeof name); }

void change_tool(Content content, wire::TrackedTool &tool) {
  switch (content) {
  case Content::kNotFinite:
    tool.status = bregma_wire_TOOL_VISIBLE;
    tool.T_tracker_tool.translation_mm[1] = geometry::kUnknown;
    break;
  case Content::kNotFiniteRms:
    tool.status = bregma_wire_TOOL_VISIBLE;
    tool.marker_rms_mm = geometry::kUnknown;
    break;
  case Content::kJump:
  case Content::kJumpReference:
    tool.T_tracker_tool.translation_mm[0] += kJump_mm;
    break;
  case Content::kResidual:
    tool.T_tracker_tool.translation_mm[0] += kBent_mm;
    tool.marker_rms_mm = kBent_rms_mm;
    break;
  case Content::kTwoMarkers:
    tool.status = bregma_wire_TOOL_PARTLY_VISIBLE;
    tool.used_markers = 0b11;
    break;
  case Content::kForeignMarkers:
    tool.used_markers |= 1U << 20;
    break;
  case Content::kHiddenWithMarkers:
    tool.status = bregma_wire_TOOL_VISIBLE;
    tool.used_markers = 0b111; // of four or five
    break;
  case Content::kNoName:
    fill(tool.tool);
    break;
  default:
    break;
  }
}

void change_body(Content content, wire::TrackedTool &tool) {
  double *q = tool.T_tracker_tool.rotation_wxyz;
  double *t = tool.T_tracker_tool.translation_mm;
  if (content == Content::kMirrored) { // at the plane x = 0 of the tracker
    t[0] = -t[0];
    q[2] = -q[2];
    q[3] = -q[3];
  } else if (content == Content::kTransposed) {
    std::for_each(q + 1, q + 4, [](double &part) { part = -part; });
  } else if (content == Content::kMetres) {
    std::for_each(t, t + 3, [](double &part) { part *= 1e-3; });
  }
}

} // namespace

template <> void Tamper<wire::TrackerFrame>::change_values(wire::TrackerFrame &frame) {
  switch (content_) {
  case Content::kFrozen:
    std::copy(std::begin(first_->tools), std::end(first_->tools), frame.tools);
    return;
  case Content::kFrozenReference:
    *find(frame, kReference) = *find(*first_, kReference);
    return;
  case Content::kMirrored:
  case Content::kTransposed:
  case Content::kMetres:
    for (wire::TrackedTool &tool : tools_of(frame)) {
      change_body(content_, tool);
    }
    return;
  case Content::kStrangeTool: {
    wire::TrackedTool &strange = frame.tools[frame.tool_count];
    strange = frame.tools[0];
    (void)wire::set_name(strange.tool, "Stranger");
    ++frame.tool_count;
    return;
  }
  case Content::kTooManyParts:
    frame.tool_count = bregma_wire_MAX_TOOLS + 1;
    return;
  default:
    change_tool(content_, *find(frame, content_ == Content::kJumpReference ? kReference : tool_));
  }
}

template <> void Tamper<wire::RobotState>::change_values(wire::RobotState &state) {
  switch (content_) {
  case Content::kFrozen:
    std::copy(std::begin(first_->joint_position_rad), std::end(first_->joint_position_rad), state.joint_position_rad);
    std::copy(std::begin(first_->joint_effort_Nm), std::end(first_->joint_effort_Nm), state.joint_effort_Nm);
    state.T_base_flange = first_->T_base_flange;
    break;
  case Content::kNotFinite:
    state.joint_position_rad[0] = geometry::kUnknown;
    break;
  case Content::kJump:
    state.T_base_flange.translation_mm[0] += kJump_mm;
    break;
  case Content::kTooManyParts:
    state.joint_count = bregma_wire_MAX_JOINTS + 1;
    break;
  default:
    break;
  }
}

template <> void Tamper<wire::RangeSample>::change_values(wire::RangeSample &sample) {
  switch (content_) {
  case Content::kFrozen:
    sample.range_mm = first_->range_mm;
    sample.status = first_->status;
    break;
  case Content::kNotFinite:
    sample.status = bregma_wire_RANGE_VALID;
    sample.range_mm = geometry::kUnknown;
    break;
  case Content::kJump:
    sample.range_mm += kJump_mm;
    break;
  case Content::kTooManyParts:
    sample.status = -1;
    break;
  default:
    break;
  }
}

template <> void Tamper<wire::ForceSample>::change_values(wire::ForceSample &sample) {
  switch (content_) {
  case Content::kFrozen:
    std::copy(std::begin(first_->force_N), std::end(first_->force_N), sample.force_N);
    std::copy(std::begin(first_->torque_Nmm), std::end(first_->torque_Nmm), sample.torque_Nmm);
    break;
  case Content::kNotFinite:
    sample.torque_Nmm[2] = geometry::kUnknown;
    break;
  case Content::kJump:
    sample.force_N[2] += 5.0;
    break;
  default:
    break;
  }
}

template <class Sample> void Tamper<Sample>::change(Sample &sample) {
  if (!first_) {
    first_ = sample;
  }
  switch (content_) {
  case Content::kTrue:
  case Content::kFlood:
  case Content::kSecondWriter:
    break;
  case Content::kDeviceClock:
    sample.device_time_ns += step_ns_;
    break;
  case Content::kDriverClock:
    sample.sent_time_ns += step_ns_;
    break;
  case Content::kRenumbered:
    sample.frame -= before_.frame;
    sample.device_time_ns -= kRestartedClock_ns;
    break;
  case Content::kNoPeriod:
    sample.period_ns = 0;
    break;
  case Content::kStrangeDevice:
    (void)wire::set_name(sample.device, "Stranger");
    break;
  default:
    change_values(sample);
  }
}

template <class Sample> bool Tamper<Sample>::stays() const {
  return content_ == Content::kDeviceClock || content_ == Content::kDriverClock || content_ == Content::kRenumbered;
}

template class Tamper<wire::TrackerFrame>;
template class Tamper<wire::RobotState>;
template class Tamper<wire::RangeSample>;
template class Tamper<wire::ForceSample>;

FrameTruth truth_of(Content content, const std::string &tool, std::int64_t exposure_ns) {
  FrameTruth out{exposure_ns, false, {}};
  switch (content) {
  case Content::kNotFinite:
  case Content::kNotFiniteRms:
  case Content::kTwoMarkers:
  case Content::kForeignMarkers:
  case Content::kHiddenWithMarkers:
  case Content::kNoName:
    out.unusable_tool = tool;
    break;
  case Content::kTooManyParts:
  case Content::kNoPeriod:
  case Content::kStrangeDevice:
    out.unusable = true;
    break;
  default:
    break;
  }
  return out;
}

wire::TrackerFrame foreign_frame(const wire::TrackerFrame &frame) {
  wire::TrackerFrame out = frame;
  out.frame += kForeignNumbers;
  for (wire::TrackedTool &tool : tools_of(out)) {
    tool.T_tracker_tool.translation_mm[0] += wire::view(tool.tool) == kReference ? 0.0 : 20.0;
  }
  return out;
}

} // namespace bregma::faults
