// Errors for invalid scenario files, and the values of a valid one.
#include <gtest/gtest.h>

#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

namespace {

const std::string kStep = "[[steps]]\ndo = \"load_case\"\n";

std::string message(const std::string &toml) {
  const auto scenario = parse_scenario(toml, "room.toml");
  return scenario ? "accepted" : scenario.error().message;
}

} // namespace

TEST(Scenario, ReadsParametersStepsFaultsAndLimits) {
  const auto scenario = parse_scenario(R"(
[tracker]
rate_hz = 1000
noise_depth_mm = 0.3
[operator]
attempts = 5
[patient]
camera_direction = [0.0, 1.0, 0.0]
[[steps]]
do = "touch_fiducials"
tool = "Stylus"
points = ["F1", "F2"]
[[steps]]
do = "follow_trajectory"
name = "first pass"
tool = "Probe"
trajectory = "Biopsy"
speed_mm_s = 5
[[faults]]
kind = "reference_bump"
step = "first pass"
after_s = 1.5
[[faults]]
kind = "bad_samples"
sample = "not_a_rotation"
count = 12
[limits]
max_fre_mm = 1.5
min_surface_samples = 250
require_verified = true
)",
                                       "room.toml");
  ASSERT_TRUE(scenario) << scenario.error().message;
  EXPECT_EQ(scenario->tracker.rate_hz, 1000.0);
  EXPECT_EQ(scenario->tracker.noise_depth_mm, 0.3);
  EXPECT_EQ(scenario->tracker.noise_lateral_mm, 0.10) << "default";
  EXPECT_EQ(scenario->hand.attempts, 5);
  EXPECT_EQ(scenario->patient.camera_direction, Eigen::Vector3d(0, 1, 0));
  ASSERT_EQ(scenario->steps.size(), 2U);
  EXPECT_EQ(scenario->steps[0].kind, StepKind::kTouchFiducials);
  EXPECT_EQ(scenario->steps[0].name, "touch_fiducials");
  EXPECT_EQ(scenario->steps[0].points, (std::vector<std::string>{"F1", "F2"}));
  EXPECT_EQ(scenario->steps[1].name, "first pass");
  EXPECT_EQ(scenario->steps[1].speed_mm_s, 5.0);
  ASSERT_EQ(scenario->faults.size(), 2U);
  EXPECT_EQ(scenario->faults[0].magnitude_mm, 2.0) << "default";
  EXPECT_EQ(scenario->faults[0].after_s, 1.5);
  EXPECT_EQ(scenario->faults[1].sample, BadSample::kNotARotation);
  EXPECT_EQ(scenario->faults[1].count, 12);
  EXPECT_EQ(scenario->limits.max_fre_mm, 1.5);
  EXPECT_EQ(scenario->limits.min_surface_samples, 250);
  EXPECT_EQ(scenario->limits.max_latency_p99_ms, std::nullopt) << "not given: not checked";
  EXPECT_TRUE(scenario->limits.require_verified);
}

TEST(Scenario, NamesFileLineKeyValueAndProblem) {
  EXPECT_EQ(message("[tracker]\nrate_hz = 5000\n" + kStep),
            "room.toml:2: tracker.rate_hz = 5000: must be between 20 and 1000 Hz");
  EXPECT_EQ(message("[tracker]\nrate_hz = \"fast\"\n" + kStep),
            "room.toml:2: tracker.rate_hz = \"fast\": must be a number, in Hz");
  EXPECT_NE(message("[tracker]\nrate = 250\n" + kStep).find("room.toml:2: tracker.rate"), std::string::npos)
      << message("[tracker]\nrate = 250\n" + kStep);
  EXPECT_EQ(message("[tracker]\nnear_mm = 3000\n" + kStep),
            "room.toml:2: tracker.near_mm = 3000: must be below far_mm");
  EXPECT_NE(message("[[steps]]\ndo = \"dance\"\n").find("room.toml:2: steps[0].do = \"dance\": "), std::string::npos)
      << message("[[steps]]\ndo = \"dance\"\n");
  EXPECT_NE(message("[[steps]]\ndo = \"pivot\"\n").find("steps[0].tool"), std::string::npos)
      << message("[[steps]]\ndo = \"pivot\"\n");
  EXPECT_NE(message("[[steps]]\ndo = \"load_case\"\ntool = \"Stylus\"\n").find("room.toml:3: steps[0].tool"),
            std::string::npos)
      << "a key that this kind of step does not have: "
      << message("[[steps]]\ndo = \"load_case\"\ntool = \"Stylus\"\n");
  EXPECT_NE(message("").find("a scenario needs at least one [[steps]]"), std::string::npos) << message("");
  EXPECT_EQ(message(kStep + "[[faults]]\nkind = \"flood\"\nstep = \"pivot\"\nduration_s = 1\n"),
            "room.toml:5: faults[0].step = \"pivot\": no step of this scenario has that name");
  EXPECT_EQ(message(kStep + "[[faults]]\nkind = \"reference_bump\"\nvector_mm = [1, 0, 0]\nmagnitude_mm = 2\n"),
            "room.toml:6: faults[0].magnitude_mm = 2: is given by vector_mm; only one of the two can be given");
  EXPECT_EQ(message("[[steps]]\ndo = \"load_case\"\nname = \"a name that is much too long\"\n"),
            "room.toml:3: steps[0].name = \"a name that is much too long\": must have 1 to 26 bytes");
  EXPECT_EQ(message(kStep + "[limits]\nmax_fre_mm = -1\n"),
            "room.toml:4: limits.max_fre_mm = -1: must be between 0 and 1000 mm");
  EXPECT_NE(message(kStep + "[limits]\nmax_fre = 1\n").find("room.toml:4: limits.max_fre"), std::string::npos);
  EXPECT_NE(message("[[steps]\n").find("room.toml:1"), std::string::npos) << message("[[steps]\n");
}

TEST(Scenario, NamesAMissingFile) {
  const auto scenario = load_scenario("/no/such/room.toml");
  ASSERT_FALSE(scenario);
  EXPECT_NE(scenario.error().message.find("/no/such/room.toml"), std::string::npos) << scenario.error().message;
}

TEST(Scenario, DefaultsAreNoWorseThanTheCaseStates) {
  const Scenario scenario;
  EXPECT_EQ(scenario.patient.fle_image_scale, 1.0);
  EXPECT_EQ(scenario.hand.touch_error_scale, 1.0);
  EXPECT_EQ(scenario.patient.landmark_error_scale, 1.0);
}

} // namespace bregma::sim
