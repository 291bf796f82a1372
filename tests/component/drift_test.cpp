// Drift alarms for a reference displaced by 2 mm, and no false alarms without a displacement: complete operations in
// virtual time.
#include <algorithm>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "server/session/messages.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

constexpr std::uint64_t kSeeds = 20;

const wire::Alarm *drift_alarm(const VirtualOperation &operation) {
  const auto found = std::find_if(operation.alarms().begin(), operation.alarms().end(), [](const wire::Alarm &alarm) {
    return wire::view(alarm.kind) == server::alarm::kDrift && alarm.state == bregma_wire_ALARM_RAISED;
  });
  return found != operation.alarms().end() ? &*found : nullptr;
}

// The operation up to a verified registration, followed by three check touches.
std::string checked_twice(const std::string &fault) {
  return kRegisterSteps + R"(
[[steps]]
do = "check_landmarks"
tool = "Stylus"
[[steps]]
do = "confirm_verification"
[[steps]]
do = "check_landmarks"
name = "check_again"
tool = "Stylus"
)" + fault;
}

int touches_since(const VirtualOperation &operation, const std::string &step, std::int64_t until_ns) {
  // Number of the step's landmarks answered before the time: one note per answer.
  return static_cast<int>(
      std::count_if(operation.events().begin(), operation.events().end(), [&](const sim::StepEvent &event) {
        return event.step == step && event.kind == sim::StepEvent::Kind::kNote && event.time_ns < until_ns;
      }));
}

TEST(Drift, BumpOfTwoMillimetresRaisesTheAlarmBeforeTheThirdCheckTouch) {
  const CaseFolder folder;
  const sim::Scenario scenario = scenario_of(checked_twice(R"(
[[faults]]
kind = "reference_bump"
step = "check_again"
after_s = 0.0
magnitude_mm = 2.0
)"));
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    VirtualOperation operation(folder.loaded(), scenario, seed);
    const bool completed = operation.run();
    const wire::Alarm *alarm = drift_alarm(operation);
    ASSERT_NE(alarm, nullptr) << "seed " << seed << ": no alarm; " << (completed ? "" : operation.failure());
    EXPECT_LT(touches_since(operation, "check_again", alarm->raised_time_ns), 3) << "seed " << seed;
  }
}

TEST(Drift, TwentyCleanOperationsRaiseNoDriftAlarm) {
  const CaseFolder folder;
  const sim::Scenario scenario = scenario_of(checked_twice(""));
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    VirtualOperation operation(folder.loaded(), scenario, seed);
    ASSERT_TRUE(operation.run()) << "seed " << seed << ": " << operation.failure();
    EXPECT_EQ(drift_alarm(operation), nullptr) << "seed " << seed;
    EXPECT_EQ(operation.session().state(), bregma_wire_SESSION_VERIFIED) << "seed " << seed;
    EXPECT_EQ(operation.health().record_dropped, 0U) << "seed " << seed;
  }
}

} // namespace
} // namespace bregma::test
