// Lines from and to an arm: what is written reads back, and damage is named.
#include <gtest/gtest.h>

#include <string>
#include <string_view>

#include "base/checked_line.hpp"
#include "drivers/arm/arm_line.hpp"

namespace bregma::arm {
namespace {

std::string_view without_end(const std::string &line) { return std::string_view(line).substr(0, line.size() - 2); }

const LinePose kPose{{412.25, -1.0 / 3.0, 530.0}, {0.0, 1.0, 0.0, 0.0}};

TEST(ArmLine, MessagesOfTheArmReadBack) {
  const Axes axes{0.1, -1.0 / 3.0, 1e-12, 3.0, -2.5, 1e-300};
  for (const FromArm &message :
       {FromArm(Identity{"Nachi MZ07F", "SIM1", true}),
        FromArm(OperatingState{8, 32'000, ArmState::kFault, true, false, 3, 256, 1.25, FaultReason::kWatchdog}),
        FromArm(MeasuredJs{8, 32'000, axes, axes, axes}), FromArm(MeasuredCp{8, 32'000, kPose}),
        FromArm(SetpointJs{8, kMaxTime_us, axes}), FromArm(Answer{7, false, "out of reach"})}) {
    const std::string line = line_of(message);
    ASSERT_LE(line.size(), kMaxLine + 2);
    const auto read = parse_from_arm(without_end(line));
    ASSERT_TRUE(read) << line << read.error();
    EXPECT_EQ(*read, message) << line;
  }
}

TEST(ArmLine, MessagesToTheArmReadBack) {
  for (const ToArm &message :
       {ToArm(Order{Order::Kind::kReset, 9}), ToArm(MoveCp{1, 2, 3, 4, 20.0, kPose}), ToArm(Alive{2})}) {
    const std::string line = line_of(message);
    const auto read = parse_to_arm(without_end(line));
    ASSERT_TRUE(read) << read.error();
    EXPECT_EQ(*read, message);
  }
}

TEST(ArmLine, DamageIsNamed) {
  const auto from = [](std::string_view body) {
    const std::string line = base::checked_line(body);
    const auto read = parse_from_arm(without_end(line));
    return read ? "none" : std::string(read.error());
  };
  const auto to = [](std::string_view body) {
    const std::string line = base::checked_line(body);
    const auto read = parse_to_arm(without_end(line));
    return read ? "none" : std::string(read.error());
  };
  const std::string range = "a field is missing or out of range";
  EXPECT_EQ(parse_from_arm("$answer,7,1,*00").error(), "wrong checksum");
  EXPECT_EQ(parse_from_arm("hello").error(), "not a message of an arm");
  EXPECT_EQ(parse_to_arm(std::string(1000, 'x')).error(), "line too long");
  EXPECT_EQ(from("dance"), "unknown message");
  EXPECT_EQ(from("setpoint_js,1,2,0,0,0,0,0"), range);
  EXPECT_EQ(from("setpoint_js,1,2,0,0,0,0,0,0,0"), range);
  EXPECT_EQ(from("setpoint_js,1,2,0,0,nan,0,0,0"), range);
  EXPECT_EQ(from("measured_cp,1,2,0,0,0,0.5,0,0,0"), range) << "not a rotation";
  EXPECT_EQ(from("operating_state,1,2,RUNNING,1,0,0,0,0,none"), range);
  EXPECT_EQ(from("operating_state,1,2,ENABLED,1,0,0,0,-1,none"), range);
  EXPECT_EQ(to("move_cp,1,1,4,4,20,0,0,0,1,0,0,0"), range) << "index and count";
  EXPECT_EQ(to("move_cp,1,1,0,4,0,0,0,0,1,0,0,0"), range) << "speed";
  EXPECT_EQ(to("alive"), range);
  EXPECT_EQ(to("enable,x"), range);
}

TEST(ArmLine, TextsKeepToTheLine) {
  EXPECT_EQ(line_text("a,b*c$d\n"), "a b c d ");
  EXPECT_EQ(line_text(std::string(200, 'x')).size(), kMaxText);
}

} // namespace
} // namespace bregma::arm
