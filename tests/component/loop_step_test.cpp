// No step of a stage allocates, except workers: all stages of the daemon run a complete operation with malloc
// interposed.
#include <map>
#include <string>

#include <gtest/gtest.h>

#include "server/stages/tissue_model/stage.hpp"
#include "tests/component/operation_fixture.hpp"
#include "tests/support/allocation_counter.hpp"

namespace bregma::test {
namespace {

TEST(LoopStep, NoStepOfAnyLoopAllocatesInACompleteOperation) {
  if (!AllocationScope::available()) {
    GTEST_SKIP() << "a sanitizer has malloc";
  }
  const CaseFolder folder;
  server::Config config = quick_config();
  config.stages.of<server::TissueModelParameters>().elements = 2000;
  VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps), kSeed, config);
  struct Count {
    std::uint64_t steps = 0;
    std::uint64_t allocations = 0;
  };
  std::map<std::string, Count> counts;
  operation.loops().around([&counts](const server::Stage &stage, const std::function<void()> &step) {
    if (stage.schedule().thread == server::ThreadClass::kWorker) {
      step();
      return;
    }
    Count &count = counts[stage.name()];
    const AllocationScope scope;
    step();
    count.allocations += scope.count();
    ++count.steps;
  });
  std::uint64_t live = 0;
  operation.observe([&live](const wire::NavigationState &state, const wire::SimulatedTruth *) {
    live += state.status == bregma_wire_POSE_LIVE ? 1 : 0;
  });
  ASSERT_TRUE(operation.run()) << operation.failure();
  EXPECT_GT(operation.received_frames(), 5'000U);
  EXPECT_GT(live, 1'000U);
  for (const char *stage : {"navigation", "sensors", "registration", "monitoring", "deformation"}) {
    EXPECT_GT(counts[stage].steps, 500U) << stage;
  }
  for (const auto &[stage, count] : counts) {
    EXPECT_EQ(count.allocations, 0U) << stage;
  }
}

} // namespace
} // namespace bregma::test
