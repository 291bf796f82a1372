// A registration without fiducials: the skin is traced, the daemon finds the head's pose from anywhere and says when it
// cannot know.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

constexpr const char *kPivotAndStart = R"(
[[steps]]
do = "load_case"
[[steps]]
do = "pivot"
tool = "Stylus"
duration_s = 6.0
[[steps]]
do = "start_registration"
)";

// Waits for the search before the estimate is accepted, and for the loop to say so afterwards.
std::string traced(double length_mm) {
  const std::string wait = "[[steps]]\ndo = \"wait\"\nduration_s = 2.0\n";
  return std::string(kPivotAndStart) +
         "[[steps]]\ndo = \"trace_scalp\"\ntool = \"Stylus\"\nlength_mm = " + std::to_string(length_mm) + "\n" + wait +
         "[[steps]]\ndo = \"accept_registration\"\n" + wait;
}

TEST(SkinAlone, IsEnoughWhereItFixesThePose) {
  const CaseFolder folder;
  VirtualOperation operation(folder.loaded(), scenario_of(traced(1800.0)), kSeed);
  wire::Pose true_pose = wire::unknown_pose();
  operation.observe([&](const wire::NavigationState &, const wire::SimulatedTruth *truth) {
    true_pose = truth != nullptr ? truth->T_image_reference : true_pose;
  });
  ASSERT_TRUE(operation.run()) << operation.failure() << "\n" << operation.registration().text;
  EXPECT_EQ(operation.registration().fiducial_count, 0U);
  ASSERT_NE(operation.registration().accepted_revision, 0U) << operation.registration().text;
  EXPECT_TRUE(std::isnan(operation.registration().fre_mm)) << "no fiducials, no FRE";
  const auto T_image_reference = wire::from_wire<geometry::frame::Image, geometry::frame::Reference>(
      operation.registration().accepted_T_image_reference);
  const auto truth = wire::from_wire<geometry::frame::Image, geometry::frame::Reference>(true_pose);
  const Eigen::Vector3d target = folder.loaded().targets.front().position_mm;
  const double error_mm = (T_image_reference * (truth.inverse() * target) - target).norm();
  std::printf("error at the target %.2f mm, %s, seed %llu\n", error_mm, operation.registration().text,
              static_cast<unsigned long long>(kSeed));
  EXPECT_LT(error_mm, folder.loaded().limits.max_target_tre_mm);
}

TEST(SkinAlone, TooLittleOfItIsRefusedWithAdvice) {
  const CaseFolder folder;
  VirtualOperation operation(folder.loaded(), scenario_of(traced(150.0)), kSeed);
  EXPECT_FALSE(operation.run());
  EXPECT_NE(operation.failure().find("accept_registration"), std::string::npos) << operation.failure();
  EXPECT_EQ(operation.registration().accepted_revision, 0U);
  EXPECT_EQ(operation.registration().status, bregma_wire_REGISTRATION_REFUSED);
  EXPECT_EQ(operation.registration().reason, bregma_wire_REFUSAL_TOO_FEW_FIDUCIALS);
}

} // namespace
} // namespace bregma::test
