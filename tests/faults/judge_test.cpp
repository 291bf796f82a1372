// The judge recognises what it must: a cell is run whose expectation does not suit its fault.
#include <algorithm>

#include <gtest/gtest.h>

#include "tests/faults/ledger.hpp"
#include "tests/faults/run.hpp"

namespace bregma::faults {
namespace {

bool violates(const Outcome &outcome, const std::string &rule) {
  return std::any_of(outcome.violations.begin(), outcome.violations.end(),
                     [&rule](const Violation &violation) { return violation.rule == rule; });
}

Outcome run_navigating(const Cell &cell) {
  static const Sessions kSessions;
  return run(kSessions, cell, During::kNavigating);
}

TEST(Judge, SilenceThatMustNotDisturbIsAGapAndAFalseAlarm) {
  const Outcome outcome = run_navigating({.subject = Subject::kTracker, .lasts_s = 2.0, .link = {.cut = true}});
  EXPECT_TRUE(violates(outcome, "gap"));
  EXPECT_TRUE(violates(outcome, "false alarm"));
  EXPECT_GT(outcome.figures.gap_ms, 1900.0);
}

TEST(Judge, AnAlarmThatIsNotRaisedIsMissed) {
  EXPECT_TRUE(violates(run_navigating({.expect = {.alarm = {"no such alarm"}}}), "no alarm"));
}

TEST(Judge, ASessionThatIsLostIsNotRecoveredFrom) {
  const Cell cell{.lasts_s = 1.0, .host = HostFault::kStateDamaged, .expect = {.critical = true, .max_gap_ms = 0.0}};
  EXPECT_TRUE(violates(run_navigating(cell), "not back"));
}

TEST(DeviceLedger, CountsANumberOnceAndAGapOnce) {
  DeviceLedger ledger;
  for (const std::uint64_t number : {5U, 6U, 8U, 8U, 7U, 12U}) {
    ledger.arrived(number, true, 0, static_cast<std::int64_t>(number));
  }
  EXPECT_EQ(ledger.lost(4), 1U); // 7 is still missing
  EXPECT_EQ(ledger.lost(5), 0U);
  EXPECT_EQ(ledger.lost(6), 3U); // 9, 10, 11
  EXPECT_EQ(ledger.arrivals(7), 2U);
}

TEST(DeviceLedger, ForeignSamplesAndNewNumbersLeaveNoGap) {
  DeviceLedger ledger;
  ledger.arrived(5, true, 0, 1);
  ledger.arrived(1'000'000, false, 0, 2);
  ledger.restart_numbers();
  ledger.arrived(1, true, 7, 3);
  EXPECT_EQ(ledger.lost(3), 0U);
  EXPECT_EQ(ledger.newest_sent_ns(), 7);
}

} // namespace
} // namespace bregma::faults
