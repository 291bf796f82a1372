// The decision whether a key is held down, from what a terminal reports.
#include <gtest/gtest.h>

#include "clients/cli/held_key.hpp"

namespace bregma::cli {
namespace {

constexpr std::int64_t kMs = 1'000'000;

TEST(KeyRepetition, OnePressIsNotHeld) {
  KeyRepetition key;
  EXPECT_FALSE(key.held(5'000 * kMs));
  key.pressed(5'000 * kMs);
  EXPECT_FALSE(key.held(5'000 * kMs));
  key.pressed(6'500 * kMs); // another press, too late for a repetition
  EXPECT_FALSE(key.held(6'510 * kMs));
}

TEST(KeyRepetition, IsHeldWhileTheTerminalRepeatsIt) {
  KeyRepetition key;
  std::int64_t now = 5'000 * kMs;
  key.pressed(now);
  now += 500 * kMs; // the pause before the first repetition
  for (int i = 0; i < 20; ++i, now += 33 * kMs) {
    key.pressed(now);
    EXPECT_TRUE(key.held(now));
    EXPECT_TRUE(key.held(now + 100 * kMs));
  }
  EXPECT_FALSE(key.held(now + 130 * kMs)); // 163 ms after the last repetition
  // Pressed again after a release: not before it repeats.
  now += 400 * kMs;
  key.pressed(now);
  EXPECT_FALSE(key.held(now));
  key.pressed(now + 500 * kMs);
  EXPECT_TRUE(key.held(now + 500 * kMs));
}

} // namespace
} // namespace bregma::cli
