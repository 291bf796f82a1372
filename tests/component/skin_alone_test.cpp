// A registration without fiducials: the skin is traced, and the daemon searches the head's pose from any start and
// reports if it is undetermined.
#include <string>

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

// Waits for the search before the estimate is accepted, and then for the loop's state.
std::string traced(double length_mm) {
  const std::string wait = "[[steps]]\ndo = \"wait\"\nduration_s = 2.0\n";
  return std::string(kPivotAndStart) +
         "[[steps]]\ndo = \"trace_scalp\"\ntool = \"Stylus\"\nlength_mm = " + std::to_string(length_mm) + "\n" + wait +
         "[[steps]]\ndo = \"accept_registration\"\n" + wait;
}

// This head is a smooth ellipsoid with a nose: a trace of the scalp may slide on it, which the search reports.
TEST(SkinAlone, IsRefusedWithTheNextPointIfItDoesNotDetermineThePose) {
  const CaseFolder folder;
  VirtualOperation operation(folder.loaded(), scenario_of(traced(1800.0)), kSeed);
  EXPECT_FALSE(operation.run());
  EXPECT_NE(operation.failure().find("accept_registration"), std::string::npos) << operation.failure();
  EXPECT_EQ(operation.registration().accepted_revision, 0U);
  EXPECT_EQ(operation.registration().status, bregma_wire_REGISTRATION_REFUSED);
  EXPECT_NE(std::string(operation.registration().text).find("touch the surface at"), std::string::npos)
      << operation.registration().text;
}

TEST(SkinAlone, TooFewSamplesAreRefusedWithAdvice) {
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
