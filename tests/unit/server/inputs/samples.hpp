// Valid samples, which tests modify.
#pragma once

#include <string>

#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace bregma::inputs {

inline constexpr std::int64_t kMs = 1'000'000;
inline constexpr std::int64_t kSecond = 1'000 * kMs;
inline constexpr std::int64_t kStart_ns = 1'700'000'000'000 * kMs;
inline constexpr std::int64_t kPeriod_ns = 4 * kMs;

inline void name(wire::Name &out, const std::string &text) { ASSERT_TRUE(wire::set_name(out, text)); }

inline constexpr wire::Pose kPose{{1.0, 0.0, 0.0, 0.0}, {10.0, 20.0, -1500.0}};

// Frame number i, exposed and sent i periods after the start.
template <class Sample>
Sample stamped(const std::string &device, std::uint64_t i, std::int64_t period_ns = kPeriod_ns) {
  Sample out{};
  name(out.device, device);
  out.frame = 100 + i;
  out.device_time_ns = kStart_ns + static_cast<std::int64_t>(i) * period_ns;
  out.sent_time_ns = out.device_time_ns;
  out.period_ns = period_ns;
  return out;
}

inline wire::TrackerFrame tracker_frame(std::uint64_t i, std::int64_t period_ns = kPeriod_ns) {
  auto out = stamped<wire::TrackerFrame>("Tracker", i, period_ns);
  out.tool_count = 2;
  name(out.tools[0].tool, "Reference");
  name(out.tools[1].tool, "Stylus");
  for (std::uint32_t t = 0; t < out.tool_count; ++t) {
    out.tools[t].status = bregma_wire_TOOL_VISIBLE;
    out.tools[t].used_markers = 0b1111;
    out.tools[t].T_tracker_tool = kPose;
    out.tools[t].marker_rms_mm = 0.1;
  }
  return out;
}

inline wire::RobotState robot_state(std::uint64_t i) {
  auto out = stamped<wire::RobotState>("Robot", i);
  out.mode = bregma_wire_ROBOT_ENABLED;
  out.joint_count = 6;
  out.T_base_flange = kPose;
  return out;
}

inline wire::RobotMotionState robot_motion(std::uint64_t i) {
  auto out = stamped<wire::RobotMotionState>("Robot", i);
  out.operating_state = bregma_wire_ROBOT_ENABLED;
  out.phase = bregma_wire_MOTION_NONE;
  out.cause = bregma_wire_STOP_NONE;
  out.joint_count = 6;
  out.deadman_age_ms = out.stop_distance_mm = wire::kUnknown;
  return out;
}

inline wire::RangeSample range_sample(std::uint64_t i) {
  auto out = stamped<wire::RangeSample>("Range", i);
  out.range_mm = 120.0;
  out.status = bregma_wire_RANGE_VALID;
  out.sigma_mm = 0.2;
  return out;
}

inline wire::ForceSample force_sample(std::uint64_t i) {
  auto out = stamped<wire::ForceSample>("Force", i);
  out.force_N[2] = -0.4;
  return out;
}

} // namespace bregma::inputs
