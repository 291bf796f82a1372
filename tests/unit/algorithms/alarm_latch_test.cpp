#include <gtest/gtest.h>

#include "algorithms/monitoring/alarm_latch.hpp"

namespace {

using bregma::monitoring::AlarmLatch;
using Change = AlarmLatch::Change;
constexpr std::int64_t kMs = 1'000'000;

TEST(AlarmLatch, RaisesWhenTheConditionHasHeldAndClearsWhenItHasGone) {
  AlarmLatch latch(100 * kMs, 500 * kMs);
  EXPECT_EQ(latch.update(true, 1000 * kMs), Change::kNone);
  EXPECT_EQ(latch.update(true, 1099 * kMs), Change::kNone);
  EXPECT_EQ(latch.update(true, 1100 * kMs), Change::kRaised);
  EXPECT_EQ(latch.update(true, 1200 * kMs), Change::kNone);
  EXPECT_EQ(latch.update(false, 1300 * kMs), Change::kNone);
  EXPECT_EQ(latch.update(false, 1799 * kMs), Change::kNone);
  EXPECT_TRUE(latch.raised());
  EXPECT_EQ(latch.update(false, 1800 * kMs), Change::kCleared);
  EXPECT_FALSE(latch.raised());
}

TEST(AlarmLatch, AFlickeringConditionNeitherRaisesNorClears) {
  AlarmLatch latch(100 * kMs, 100 * kMs);
  for (int i = 0; i < 50; ++i) {
    EXPECT_EQ(latch.update(i % 2 == 0, 60 * kMs * i), Change::kNone);
  }
  EXPECT_EQ(latch.update(true, 3000 * kMs), Change::kNone);
  EXPECT_EQ(latch.update(true, 3100 * kMs), Change::kRaised);
  for (int i = 0; i < 50; ++i) {
    EXPECT_EQ(latch.update(i % 2 == 0, (3200 + i * 60) * kMs), Change::kNone);
  }
  EXPECT_TRUE(latch.raised());
}

TEST(AlarmLatch, CountsUpdatesInARow) {
  AlarmLatch latch(0, 0, 3);
  EXPECT_EQ(latch.update(true, 1), Change::kNone);
  EXPECT_EQ(latch.update(true, 2), Change::kNone);
  EXPECT_EQ(latch.update(false, 3), Change::kNone);
  EXPECT_EQ(latch.update(true, 4), Change::kNone);
  EXPECT_EQ(latch.update(true, 5), Change::kNone);
  EXPECT_EQ(latch.update(true, 6), Change::kRaised);
  EXPECT_EQ(latch.update(false, 7), Change::kCleared);
}

TEST(AlarmLatch, StaysWhenItMustNotClearByItselfUntilReset) {
  AlarmLatch latch(0, -1);
  EXPECT_EQ(latch.update(true, 1), Change::kRaised);
  EXPECT_EQ(latch.update(false, 1'000'000 * kMs), Change::kNone);
  EXPECT_TRUE(latch.raised());
  latch.reset();
  EXPECT_FALSE(latch.raised());
  EXPECT_EQ(latch.update(true, 2), Change::kRaised);
}

} // namespace
