#include "server/session/command_gate.hpp"

#include <gtest/gtest.h>

namespace bregma::server {
namespace {

using Verdict = CommandGate::Verdict;
constexpr std::int64_t kMs = 1'000'000;

struct Count {
  int admitted = 0, refused = 0, ignored = 0;
  void add(Verdict verdict) {
    ++(verdict == Verdict::kAdmitted ? admitted : verdict == Verdict::kRefused ? refused : ignored);
  }
};

TEST(CommandGate, AFloodIsLimitedAndDoesNotAffectOtherWriters) {
  CommandGate gate;
  Count flood;
  Count other;
  for (std::int64_t i = 0; i < 100'000; ++i) { // 10 s of 10,000 per second
    const std::int64_t now_ns = i * kMs / 10;
    flood.add(gate.judge(1, now_ns));
    if (i % 1'000 == 0) {
      other.add(gate.judge(2, now_ns));
    }
  }
  EXPECT_NEAR(flood.admitted, CommandGate::kBurst + 10 * CommandGate::kRate_hz, 2);
  EXPECT_NEAR(flood.refused, 11 * CommandGate::kRefusalRate_hz, 2);
  EXPECT_EQ(other.admitted, 100);
  EXPECT_EQ(gate.excess(), static_cast<std::uint64_t>(flood.refused + flood.ignored));
}

TEST(CommandGate, ALastingRateBelowTheLimitIsNeverRefused) {
  CommandGate gate;
  Count count;
  for (std::int64_t i = 0; i < 10'000; ++i) {
    count.add(gate.judge(1, i * 21 * kMs));
  }
  EXPECT_EQ(count.admitted, 10'000);
}

TEST(CommandGate, AnyNumberOfWritersIsKnownAndTheMostSilentIsForgotten) {
  CommandGate gate;
  for (int i = 0; i < 1'000; ++i) {
    (void)gate.judge(7, 0);
  }
  for (std::uint64_t writer = 100; writer < 100 + 2 * CommandGate::kMaxWriters; ++writer) {
    EXPECT_EQ(gate.judge(writer, static_cast<std::int64_t>(writer)), Verdict::kAdmitted);
    EXPECT_NE(gate.judge(7, static_cast<std::int64_t>(writer)), Verdict::kAdmitted) << "it still sends";
  }
}

} // namespace
} // namespace bregma::server
