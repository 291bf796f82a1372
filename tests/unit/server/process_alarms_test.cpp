#include "server/process_alarms.hpp"

#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::vector<AlarmCondition> taken(ProcessAlarms &alarms) {
  std::vector<AlarmCondition> out;
  AlarmCondition condition;
  while (alarms.events.try_pop(condition)) {
    out.push_back(condition);
  }
  return out;
}

TEST(ProcessAlarms, AnotherDaemonIsCriticalAtOnceAndNamed) {
  ProcessAlarms alarms;
  alarms.update({}, 0);
  EXPECT_TRUE(taken(alarms).empty());
  alarms.update({"process 7 on or-3", "", {}}, kSecond_ns);
  const auto raised = taken(alarms);
  ASSERT_EQ(raised.size(), 1U);
  EXPECT_EQ(wire::view(raised[0].kind), alarm::kOtherDaemon);
  EXPECT_EQ(raised[0].severity, bregma_wire_SEVERITY_CRITICAL);
  EXPECT_EQ(raised[0].effect, SessionEffect::kNone) << "the daemon that navigates goes on";
  EXPECT_NE(std::string(raised[0].text).find("process 7 on or-3"), std::string::npos);
  alarms.update({}, 2 * kSecond_ns);
  alarms.update({}, 3 * kSecond_ns);
  const auto cleared = taken(alarms);
  ASSERT_EQ(cleared.size(), 1U);
  EXPECT_FALSE(cleared[0].active);
}

TEST(ProcessAlarms, ARefusedUserOfTheStateDirectoryIsShownForTenSeconds) {
  ProcessAlarms alarms;
  alarms.update({"", "process 4711", {}}, 0);
  const auto raised = taken(alarms);
  ASSERT_EQ(raised.size(), 1U);
  EXPECT_EQ(wire::view(raised[0].kind), alarm::kStateUser);
  EXPECT_EQ(raised[0].severity, bregma_wire_SEVERITY_CRITICAL);
  alarms.update({}, 1 * kSecond_ns);
  alarms.update({}, 10 * kSecond_ns);
  EXPECT_TRUE(taken(alarms).empty());
  alarms.update({}, 11 * kSecond_ns);
  EXPECT_EQ(taken(alarms).size(), 1U);
}

TEST(ProcessAlarms, AnOverrunNamesItsLoopAndManyAreOneAlarm) {
  ProcessAlarms alarms;
  for (std::int64_t second = 0; second < 600; ++second) { // an overrun every ten seconds
    const auto overruns = static_cast<std::uint64_t>(second / 10);
    alarms.update({"", "", {{"navigation", 0}, {"monitoring", overruns}}}, second * kSecond_ns);
  }
  const auto raised = taken(alarms);
  ASSERT_EQ(raised.size(), 1U);
  EXPECT_EQ(wire::view(raised[0].kind), alarm::kOverrun);
  EXPECT_EQ(wire::view(raised[0].subject), "monitoring");
}

} // namespace
} // namespace bregma::server
