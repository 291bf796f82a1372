#include <string>

#include <gtest/gtest.h>

#include "tests/unit/robot/arms.hpp"

namespace bregma::casefile {
namespace {

// The same arm as robots/mz07f.toml, with a tool plate as a fixed joint.
std::string urdf() {
  const auto joint = [](int i, const std::string &xyz, const std::string &rpy, const std::string &limits) {
    const std::string n = std::to_string(i);
    return "<joint name='j" + n + "' type='revolute'><parent link='l" + std::to_string(i - 1) + "'/><child link='l" +
           n + "'/><origin xyz='" + xyz + "' rpy='" + rpy + "'/><axis xyz='0 0 1'/><limit " + limits +
           " effort='1' velocity='1'/></joint>";
  };
  const std::string right = "1.5707963267948966 0 0";
  const std::string back = "-1.5707963267948966 0 0";
  return "<?xml version='1.0'?><robot name='Nachi MZ07F'><link name='l0'/>" +
         joint(1, "0 0 0", "0 0 0", "lower='-2.9670597283903604' upper='2.9670597283903604'") +
         joint(2, "0.05 0 0.355", right, "lower='-0.7853981633974483' upper='2.9670597283903604'") +
         joint(3, "0.33 0 0", "0 0 0", "lower='-1.1344640137963142' upper='3.3161255787892263'") +
         joint(4, "0.045 0 0", right, "lower='-3.3161255787892263' upper='3.3161255787892263'") +
         joint(5, "0 0 0.34", back, "lower='-2.0943951023931953' upper='2.0943951023931953'") +
         joint(6, "0 0 0", right, "lower='-6.283185307179586' upper='6.283185307179586'") +
         "<joint name='flange' type='fixed'><parent link='l6'/><child link='tool0'/><origin xyz='0 0 0.078'/></joint>"
         "<link name='tool0'/></robot>";
}

TEST(ArmFile, UrdfAndDenavitHartenbergAreTheSameArm) {
  const auto arm = parse_urdf_arm(urdf(), "arm.urdf");
  ASSERT_TRUE(arm) << arm.error().message;
  const robot::ArmModel table = test::mz07f();
  EXPECT_EQ(arm->name(), table.name());
  std::mt19937 rng(4);
  for (int run = 0; run < 50; ++run) {
    const robot::JointAngles joints = test::random_joints(table, rng);
    const auto off = arm->forward(joints) * table.forward(joints).inverse();
    EXPECT_LT(off.translation().norm(), 1e-9);
    EXPECT_LT(geometry::rotation_log(off.rotation()).norm(), 1e-12);
  }
  for (std::size_t i = 0; i < robot::kJoints; ++i) {
    EXPECT_NEAR(arm->limits()[i].lower_rad, table.limits()[i].lower_rad, 1e-12);
    EXPECT_NEAR(arm->limits()[i].upper_rad, table.limits()[i].upper_rad, 1e-12);
  }
}

std::string replaced(std::string text, const std::string &from, const std::string &to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos);
  return text.replace(at, from.size(), to);
}

TEST(ArmFile, RefusesUrdfWithTheReason) {
  const auto message = [](const std::string &text) {
    const auto arm = parse_urdf_arm(text, "arm.urdf");
    return arm ? std::string("read") : arm.error().message;
  };
  EXPECT_EQ(message(replaced(urdf(), "name='j3' type='revolute'", "name='j3' type='prismatic'")),
            "arm.urdf:1: joint \"j3\": type \"prismatic\" is not revolute, continuous or fixed");
  EXPECT_EQ(message(replaced(urdf(), "name='j3' type='revolute'", "name='j3' type='fixed'")),
            "arm.urdf: 0 ends of the tree have six moving joints before them, exactly one is needed");
  EXPECT_EQ(message(replaced(urdf(), "<origin xyz='0.33 0 0'", "<origin xyz='0.33 0'")),
            "arm.urdf:1: joint \"j3\": its origin must be three numbers each in xyz and rpy");
  EXPECT_EQ(message(replaced(urdf(), "<axis xyz='0 0 1'/>", "<axis xyz='0 0 0'/>")),
            "arm.urdf:1: joint \"j1\": its axis has no direction");
  EXPECT_EQ(message("<mesh/>"), "arm.urdf: the outermost element is \"mesh\", not \"robot\"");
  // A loop of links has no end.
  EXPECT_NE(message("<robot><joint name='a' type='fixed'><parent link='x'/><child link='y'/></joint>"
                    "<joint name='b' type='fixed'><parent link='y'/><child link='x'/></joint></robot>")
                .find("0 ends"),
            std::string::npos);
}

TEST(ArmFile, RefusesTablesWithFileLineAndValue) {
  const auto arm = parse_dh_arm(
      "name = \"a\"\n[[joints]]\nd_mm = 1\nalpha_deg = 0\na_mm = 0\nmin_deg = 5\nmax_deg = -5\n", "arm.toml");
  ASSERT_FALSE(arm);
  EXPECT_NE(arm.error().message.find("arm.toml"), std::string::npos);
  const auto unknown = read_arm("arm.dat");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().message, "arm.dat: an arm is described in .toml (Denavit-Hartenberg) or .urdf");
}

} // namespace
} // namespace bregma::casefile
