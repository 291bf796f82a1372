// Each rule of the check, violated alone in an otherwise valid sample, gives its own reason.
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "server/inputs/payload_check.hpp"
#include "tests/unit/server/inputs/samples.hpp"

namespace bregma::inputs {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

template <class Sample> struct Spoiled {
  const char *how;
  std::function<void(Sample &)> spoil;
  wire::RejectReason reason;
};

template <class Sample>
void expect_refusals(const Sample &good, const KnownTools &tools, const std::vector<Spoiled<Sample>> &cases) {
  EXPECT_EQ(check_payload(good, tools), std::nullopt);
  for (const auto &[how, spoil, reason] : cases) {
    Sample sample = good;
    spoil(sample);
    const Rejection rejection = check_payload(sample, tools);
    ASSERT_TRUE(rejection.has_value()) << how;
    EXPECT_EQ(describe(*rejection), describe(reason)) << how;
  }
}

TEST(PayloadCheck, TrackerFrames) {
  using Frame = wire::TrackerFrame;
  const auto tools = known_tools(std::vector<std::string>{"Reference", "Stylus"});
  ASSERT_TRUE(tools.has_value());
  expect_refusals<Frame>(
      tracker_frame(1), *tools,
      {{"too many tools", [](Frame &f) { f.tool_count = bregma_wire_MAX_TOOLS + 1; }, bregma_wire_REJECT_MALFORMED},
       {"name not ended", [](Frame &f) { std::memset(f.tools[0].tool, 'x', 32); }, bregma_wire_REJECT_MALFORMED},
       {"no name", [](Frame &f) { f.tools[0].tool[0] = '\0'; }, bregma_wire_REJECT_MALFORMED},
       {"tool twice", [](Frame &f) { name(f.tools[0].tool, "Stylus"); }, bregma_wire_REJECT_MALFORMED},
       {"negative status", [](Frame &f) { f.tools[1].status = -1; }, bregma_wire_REJECT_MALFORMED},
       {"negative residual", [](Frame &f) { f.tools[1].marker_rms_mm = -1.0; }, bregma_wire_REJECT_MALFORMED},
       {"a kilometre away", [](Frame &f) { f.tools[1].T_tracker_tool.translation_mm[2] = -1e6; },
        bregma_wire_REJECT_MALFORMED},
       {"NaN position", [](Frame &f) { f.tools[1].T_tracker_tool.translation_mm[0] = wire::kUnknown; },
        bregma_wire_REJECT_NOT_FINITE},
       {"infinite rotation", [](Frame &f) { f.tools[0].T_tracker_tool.rotation_wxyz[3] = kInf; },
        bregma_wire_REJECT_NOT_FINITE},
       {"NaN residual", [](Frame &f) { f.tools[0].marker_rms_mm = wire::kUnknown; }, bregma_wire_REJECT_NOT_FINITE},
       {"zero quaternion", [](Frame &f) { f.tools[0].T_tracker_tool.rotation_wxyz[0] = 0.0; },
        bregma_wire_REJECT_NOT_A_ROTATION},
       {"quaternion of length 1.002", [](Frame &f) { f.tools[0].T_tracker_tool.rotation_wxyz[0] = 1.002; },
        bregma_wire_REJECT_NOT_A_ROTATION},
       {"huge quaternion", [](Frame &f) { f.tools[0].T_tracker_tool.rotation_wxyz[0] = 1e200; },
        bregma_wire_REJECT_NOT_A_ROTATION},
       {"NaN covariance", [](Frame &f) { f.tools[0].covariance[20] = std::numeric_limits<float>::quiet_NaN(); },
        bregma_wire_REJECT_NOT_FINITE},
       {"negative variance", [](Frame &f) { f.tools[0].covariance[0] = -1e-6F; }, bregma_wire_REJECT_MALFORMED},
       {"correlation without variance", [](Frame &f) { f.tools[0].covariance[1] = 1e-3F; },
        bregma_wire_REJECT_MALFORMED}});
}

TEST(PayloadCheck, AToolThatIsNotKnownIsIgnoredWithItsValues) {
  const auto tools = known_tools(std::vector<std::string>{"Reference", "Stylus"});
  auto frame = tracker_frame(1);
  frame.tools[2] = frame.tools[1];
  frame.tool_count = 3;
  name(frame.tools[2].tool, "Drill");
  frame.tools[2].T_tracker_tool.translation_mm[0] = wire::kUnknown;
  EXPECT_EQ(check_payload(frame, *tools), std::nullopt);
  EXPECT_EQ(check_payload(frame, KnownTools{}), bregma_wire_REJECT_NOT_FINITE) << "without a case all are known";
}

TEST(PayloadCheck, MarkersThatContradictTheToolOrItsStatus) {
  struct Case {
    wire::ToolStatus status;
    std::uint32_t used;
    std::size_t markers;
    MarkerFault fault;
  };
  constexpr auto kVisible = bregma_wire_TOOL_VISIBLE;
  constexpr auto kPartly = bregma_wire_TOOL_PARTLY_VISIBLE;
  for (const Case &one : {Case{kVisible, 0b1111, 4, MarkerFault::kNone},
                          {kPartly, 0b1011, 4, MarkerFault::kNone},
                          {kVisible, 0xFFFFFFFF, 32, MarkerFault::kNone},
                          {kVisible, 0b0011, 2, MarkerFault::kTooFew},
                          {kPartly, 0b0011, 4, MarkerFault::kTooFew},
                          {kPartly, 0, 4, MarkerFault::kTooFew},
                          {kPartly, 0b10011, 4, MarkerFault::kForeign},
                          {kVisible, 0x80000007, 3, MarkerFault::kForeign},
                          {kVisible, 0b0111, 4, MarkerFault::kNotAll},
                          {kPartly, 0b1111, 4, MarkerFault::kAll}}) {
    auto tool = tracker_frame(1).tools[1];
    tool.status = one.status;
    tool.used_markers = one.used;
    EXPECT_EQ(check_markers(tool, one.markers), one.fault) << std::hex << one.used << " of " << one.markers;
  }
  auto tool = tracker_frame(1).tools[1];
  tool.used_markers = 0;
  EXPECT_EQ(check_markers(tool, 0), MarkerFault::kNoCovariance);
  tool.covariance[20] = 0.01F;
  EXPECT_EQ(check_markers(tool, 0), MarkerFault::kNone);
  EXPECT_EQ(describe(MarkerFault::kForeign), "markers that the tool does not have");
}

TEST(PayloadCheck, AStatusOfALaterRevisionIsAToolThatIsNotSeen) {
  auto frame = tracker_frame(1);
  frame.tools[1].status = 99;
  frame.tools[1].T_tracker_tool = wire::unknown_pose();
  EXPECT_EQ(check_payload(frame, KnownTools{}), std::nullopt);
}

TEST(PayloadCheck, AStatedCovariancePasses) {
  auto frame = tracker_frame(1);
  auto &upper = frame.tools[0].covariance;
  for (std::size_t i = 0; i < 6; ++i) {
    upper[wire::upper_index(i, i)] = i < 3 ? 1e-6F : 0.04F;
  }
  upper[wire::upper_index(3, 4)] = 0.04F; // wholly correlated
  EXPECT_EQ(wire::upper_index(5, 5), 20U);
  EXPECT_EQ(check_payload(frame, KnownTools{}), std::nullopt);
  upper[wire::upper_index(3, 4)] = 0.05F;
  EXPECT_EQ(check_payload(frame, KnownTools{}), bregma_wire_REJECT_MALFORMED);
}

TEST(PayloadCheck, ThePoseOfAHiddenToolIsNotChecked) {
  auto frame = tracker_frame(1);
  frame.tools[1].status = bregma_wire_TOOL_HIDDEN;
  frame.tools[1].T_tracker_tool = wire::unknown_pose();
  frame.tools[1].marker_rms_mm = wire::kUnknown;
  EXPECT_EQ(check_payload(frame, KnownTools{}), std::nullopt);
  frame.tools[1].status = bregma_wire_TOOL_PARTLY_VISIBLE;
  EXPECT_EQ(check_payload(frame, KnownTools{}), bregma_wire_REJECT_NOT_FINITE);
}

TEST(PayloadCheck, SinglePrecisionRotationsPass) {
  auto frame = tracker_frame(1);
  auto &q = frame.tools[0].T_tracker_tool.rotation_wxyz;
  q[0] = static_cast<double>(std::sqrt(0.3F));
  q[1] = static_cast<double>(std::sqrt(0.7F));
  EXPECT_EQ(check_payload(frame, KnownTools{}), std::nullopt);
}

TEST(PayloadCheck, WithoutACaseEveryToolIsAccepted) {
  auto frame = tracker_frame(1);
  name(frame.tools[1].tool, "Drill");
  EXPECT_EQ(check_payload(frame, KnownTools{}), std::nullopt);
  EXPECT_FALSE(known_tools(std::vector<std::string>(bregma_wire_MAX_TOOLS + 1, "Tool")).has_value());
  EXPECT_FALSE(known_tools(std::vector<std::string>{std::string(32, 'x')}).has_value());
}

TEST(PayloadCheck, RobotStates) {
  using Robot = wire::RobotState;
  expect_refusals<Robot>(
      robot_state(1), {},
      {{"too many joints", [](Robot &r) { r.joint_count = 9; }, bregma_wire_REJECT_MALFORMED},
       {"negative mode", [](Robot &r) { r.mode = -2; }, bregma_wire_REJECT_MALFORMED},
       {"tool not ended", [](Robot &r) { std::memset(r.tool, 'x', 32); }, bregma_wire_REJECT_MALFORMED},
       {"motion's client not ended", [](Robot &r) { std::memset(r.motion_client, 'x', 32); },
        bregma_wire_REJECT_MALFORMED},
       {"infinite covariance", [](Robot &r) { r.covariance[3] = std::numeric_limits<float>::infinity(); },
        bregma_wire_REJECT_NOT_FINITE},
       {"NaN joint", [](Robot &r) { r.joint_position_rad[5] = wire::kUnknown; }, bregma_wire_REJECT_NOT_FINITE},
       {"infinite velocity", [](Robot &r) { r.joint_velocity_rad_s[0] = kInf; }, bregma_wire_REJECT_NOT_FINITE},
       {"NaN effort", [](Robot &r) { r.joint_effort_Nm[0] = wire::kUnknown; }, bregma_wire_REJECT_NOT_FINITE},
       {"not a rotation", [](Robot &r) { r.T_base_flange.rotation_wxyz[2] = 0.5; },
        bregma_wire_REJECT_NOT_A_ROTATION}});
  auto unused = robot_state(1);
  unused.joint_position_rad[6] = wire::kUnknown; // beyond joint_count
  EXPECT_EQ(check_payload(unused, {}), std::nullopt);
  unused.mode = 99; // a value of a later revision counts as unknown
  EXPECT_EQ(check_payload(unused, {}), std::nullopt);
}

TEST(PayloadCheck, MotionsOfAnArm) {
  using Motion = wire::RobotMotionState;
  expect_refusals<Motion>(
      robot_motion(1), {},
      {{"too many joints", [](Motion &m) { m.joint_count = 9; }, bregma_wire_REJECT_MALFORMED},
       {"negative state", [](Motion &m) { m.operating_state = -2; }, bregma_wire_REJECT_MALFORMED},
       {"negative phase", [](Motion &m) { m.phase = -1; }, bregma_wire_REJECT_MALFORMED},
       {"negative cause", [](Motion &m) { m.cause = -1; }, bregma_wire_REJECT_MALFORMED},
       {"client not ended", [](Motion &m) { std::memset(m.motion_client, 'x', 32); }, bregma_wire_REJECT_MALFORMED},
       {"text not ended", [](Motion &m) { std::memset(m.text, 'x', sizeof m.text); }, bregma_wire_REJECT_MALFORMED},
       {"too many waypoints", [](Motion &m) { m.waypoint_count = bregma_wire_MAX_WAYPOINTS + 1; },
        bregma_wire_REJECT_MALFORMED},
       {"beyond the last waypoint", [](Motion &m) { m.waypoint = 1; }, bregma_wire_REJECT_MALFORMED},
       {"NaN setpoint", [](Motion &m) { m.setpoint_jp_rad[5] = wire::kUnknown; }, bregma_wire_REJECT_NOT_FINITE},
       {"negative age", [](Motion &m) { m.deadman_age_ms = -1.0; }, bregma_wire_REJECT_MALFORMED},
       {"infinite stop", [](Motion &m) { m.stop_distance_mm = kInf; }, bregma_wire_REJECT_MALFORMED}});
  auto later = robot_motion(1);
  later.phase = later.cause = 99; // values of a later revision
  EXPECT_EQ(check_payload(later, {}), std::nullopt);
}

TEST(PayloadCheck, AMissingReadingIsNoNumber) {
  auto range = range_sample(1);
  range.range_mm = range.sigma_mm = wire::kUnknown;
  for (const wire::RangeStatus status : {bregma_wire_RANGE_MISSING, bregma_wire_RANGE_TOO_FAR, 99}) {
    range.status = status;
    EXPECT_EQ(check_payload(range, {}), std::nullopt);
  }
}

TEST(PayloadCheck, RangesAndForces) {
  using Range = wire::RangeSample;
  expect_refusals<Range>(
      range_sample(1), {},
      {{"no status", [](Range &r) { r.status = bregma_wire_RANGE_UNKNOWN; }, bregma_wire_REJECT_MALFORMED},
       {"negative status", [](Range &r) { r.status = -1; }, bregma_wire_REJECT_MALFORMED},
       {"NaN range", [](Range &r) { r.range_mm = wire::kUnknown; }, bregma_wire_REJECT_NOT_FINITE},
       {"NaN sigma", [](Range &r) { r.sigma_mm = wire::kUnknown; }, bregma_wire_REJECT_NOT_FINITE},
       {"negative range", [](Range &r) { r.range_mm = -1.0; }, bregma_wire_REJECT_MALFORMED},
       {"negative sigma", [](Range &r) { r.sigma_mm = -0.1; }, bregma_wire_REJECT_MALFORMED}});
  using Force = wire::ForceSample;
  expect_refusals<Force>(
      force_sample(1), {},
      {{"NaN force", [](Force &f) { f.force_N[1] = wire::kUnknown; }, bregma_wire_REJECT_NOT_FINITE},
       {"infinite torque", [](Force &f) { f.torque_Nmm[2] = -kInf; }, bregma_wire_REJECT_NOT_FINITE}});
}

} // namespace
} // namespace bregma::inputs
