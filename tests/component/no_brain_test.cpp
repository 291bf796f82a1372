// A case without a brain: it is registered, verified and navigated as any other, and the tissue model states why it
// makes no prediction.
#include <algorithm>
#include <set>
#include <string>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

TEST(NoBrain, TheCaseIsNavigatedToItsTargetAndTheTissueModelStatesTheReason) {
  const CaseFolder folder([](casefile::Case &c) {
    c.brain = {};
    c.craniotomy.reset();
  });
  ASSERT_TRUE(folder.loaded().brain.mesh.triangles.empty());
  const server::Config with_model; // 20,000 tetrahedra, if there were a brain
  VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps), kSeed, with_model);
  double nearest_mm = 1e9;
  operation.observe([&](const wire::NavigationState &state, const wire::SimulatedTruth *) {
    if (state.status == bregma_wire_POSE_LIVE && wire::view(state.tool) == "Probe" &&
        state.session == bregma_wire_SESSION_NAVIGATING) {
      nearest_mm = std::min(nearest_mm, state.distance_to_target_mm);
      EXPECT_EQ(state.prediction, bregma_wire_DEFORMATION_NO_MODEL);
    }
  });
  std::set<wire::DeformationReason> reasons;
  operation.topics().observe<wire::DeformationState>([&](const wire::DeformationState &state) {
    EXPECT_EQ(state.status, bregma_wire_DEFORMATION_NO_MODEL);
    EXPECT_EQ(wire::view(state.point), "Deep");
    reasons.insert(state.reason);
  });
  ASSERT_TRUE(operation.run()) << operation.failure();
  EXPECT_LT(nearest_mm, 3.0) << "the distance displayed at the target";
  EXPECT_TRUE(reasons.contains(bregma_wire_DEFORMATION_REASON_REFUSED));
}

} // namespace
} // namespace bregma::test
