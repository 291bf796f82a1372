#include "server/stages/monitoring/alarm_conditions.hpp"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr AlarmConditions::Kind kHidden{alarm::kToolHidden, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone,
                                        200 * kMs, 1000 * kMs};

std::vector<AlarmCondition> taken(AlarmEvents &events) {
  std::vector<AlarmCondition> out;
  AlarmCondition condition;
  while (events.try_pop(condition)) {
    out.push_back(condition);
  }
  return out;
}

TEST(AlarmConditions, AConditionIsInTheTableOnlyWhileItHoldsOrIsRaised) {
  AlarmEvents events;
  AlarmConditions conditions(events);
  conditions.update(kHidden, "Probe", false, "", 0);
  EXPECT_EQ(conditions.watched(), 0U);
  conditions.update(kHidden, "Probe", true, "hidden", 10 * kMs);
  EXPECT_EQ(conditions.watched(), 1U);
  conditions.update(kHidden, "Probe", false, "", 20 * kMs); // before it became an alarm
  EXPECT_EQ(conditions.watched(), 0U);
  EXPECT_TRUE(taken(events).empty());

  conditions.update(kHidden, "Probe", true, "hidden", 100 * kMs);
  conditions.update(kHidden, "Probe", true, "hidden", 300 * kMs);
  conditions.update(kHidden, "Probe", false, "", 400 * kMs);
  EXPECT_EQ(conditions.watched(), 1U); // raised, and not absent for long enough
  conditions.update(kHidden, "Probe", false, "", 1400 * kMs);
  EXPECT_EQ(conditions.watched(), 0U);
  const auto changes = taken(events);
  ASSERT_EQ(changes.size(), 2U);
  EXPECT_TRUE(changes[0].active);
  EXPECT_FALSE(changes[1].active);
}

TEST(AlarmConditions, MoreSubjectsThanExpectedAreWatchedRaisedAndCleared) {
  AlarmEvents events;
  AlarmConditions conditions(events);
  const std::size_t subjects = AlarmConditions::kExpected + 20;
  for (const bool holds : {true, false}) {
    const std::int64_t begin_ns = holds ? 0 : 10'000 * kMs;
    for (std::size_t i = 0; i < subjects; ++i) {
      conditions.update(kHidden, "Tool" + std::to_string(i), holds, "hidden", begin_ns);
      conditions.update(kHidden, "Tool" + std::to_string(i), holds, "hidden", begin_ns + 1000 * kMs);
    }
    EXPECT_EQ(conditions.watched(), holds ? subjects : 0U);
    const auto changes = taken(events);
    ASSERT_EQ(changes.size(), subjects);
    for (const AlarmCondition &change : changes) {
      EXPECT_EQ(change.active, holds);
    }
  }
}

TEST(AlarmConditions, ConditionsOfAnEarlierCasesToolsAreClearedAndRemoved) {
  AlarmEvents events;
  AlarmConditions conditions(events);
  for (const char *tool : {"Stylus", "Probe"}) {
    conditions.update(kHidden, tool, true, "hidden", 0);
  }
  conditions.update(kHidden, "Probe", true, "hidden", 200 * kMs);
  conditions.forget(alarm::kToolHidden, 300 * kMs);
  EXPECT_EQ(conditions.watched(), 0U);
  const auto changes = taken(events);
  ASSERT_EQ(changes.size(), 2U);
  EXPECT_EQ(wire::text(changes[1].subject), "Probe");
  EXPECT_FALSE(changes[1].active);
}

TEST(AlarmConditions, AChangeThatDoesNotFitTheRingIsSentLater) {
  AlarmEvents events;
  AlarmConditions conditions(events);
  while (events.try_push(AlarmCondition{})) {
  }
  constexpr AlarmConditions::Kind kAtOnce{alarm::kDrift, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kDemote, 0, 0};
  conditions.update(kAtOnce, "Reference", true, "it moved", 0);
  (void)taken(events);
  conditions.update(kAtOnce, "Reference", true, "it moved", 10 * kMs);
  const auto raised = taken(events);
  ASSERT_EQ(raised.size(), 1U);
  EXPECT_TRUE(raised[0].active);
  EXPECT_STREQ(raised[0].text, "it moved");

  while (events.try_push(AlarmCondition{})) {
  }
  conditions.forget(alarm::kDrift, 20 * kMs);
  (void)taken(events);
  conditions.update(kHidden, "Probe", false, "", 30 * kMs); // any update sends what waits
  const auto cleared = taken(events);
  ASSERT_EQ(cleared.size(), 1U);
  EXPECT_FALSE(cleared[0].active);
  EXPECT_EQ(conditions.watched(), 0U);
}

} // namespace
} // namespace bregma::server
