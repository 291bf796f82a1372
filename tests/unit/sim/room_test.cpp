// The complete room: equal bytes for equal seeds, rates, delays, losses.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "idl/names.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim::test {

namespace {

const std::string kShort = "[[steps]]\ndo = \"pivot\"\ntool = \"Stylus\"\nduration_s = 3\n"
                           "[[steps]]\ndo = \"touch_fiducials\"\ntool = \"Stylus\"\npoints = [\"F1\", \"F4\"]\n";

Recording short_run(std::uint64_t seed, std::int64_t step_ns) {
  SimulatedRoom room(make_case(), scenario_of("[tracker]\nrate_hz = 100\nmissing_share = 0.05\n" + kShort), seed);
  ScriptedDaemon daemon;
  return play(room, daemon, 60.0, step_ns);
}

} // namespace

TEST(SimulatedRoom, SameSeedSameBytes) {
  const Recording one = short_run(4, 2'000'000);
  const Recording two = short_run(4, 2'000'000);
  const Recording other = short_run(5, 2'000'000);
  ASSERT_GT(one.all.frames.size(), 500U);
  EXPECT_TRUE(same_bytes(one.all.frames, two.all.frames));
  EXPECT_TRUE(same_bytes(one.all.truths, two.all.truths));
  EXPECT_TRUE(same_bytes(one.all.robot_states, two.all.robot_states));
  EXPECT_TRUE(same_bytes(one.all.force_samples, two.all.force_samples));
  EXPECT_TRUE(same_bytes(one.all.range_samples, two.all.range_samples));
  EXPECT_TRUE(same_bytes(one.all.commands, two.all.commands));
  EXPECT_FALSE(same_bytes(one.all.frames, other.all.frames));
  EXPECT_TRUE(one.all.truths.front().seeded);
  EXPECT_EQ(one.all.truths.front().seed, 4U);
  EXPECT_EQ(other.all.truths.front().seed, 5U);
}

TEST(SimulatedRoom, TheResultIsIndependentOfTheTimeSteps) {
  const auto alone = [](std::int64_t step_ns) {
    SimulatedRoom room(make_case(), scenario_of("[[steps]]\ndo = \"wait\"\nduration_s = 3\n"), 4);
    return play_for(room, 2.0, step_ns);
  };
  const Recording fine = alone(250'000);
  const Recording coarse = alone(50'000'000);
  const std::size_t common = std::min(fine.all.frames.size(), coarse.all.frames.size());
  ASSERT_GT(common, 450U);
  for (std::size_t i = 0; i < common; ++i) {
    ASSERT_TRUE(same_bytes(&fine.all.frames[i], &coarse.all.frames[i], sizeof(wire::TrackerFrame))) << i;
  }
}

TEST(SimulatedRoom, SamplesAtTheStatedRates) {
  for (const int rate : {20, 250, 1000}) {
    SimulatedRoom room(make_case(),
                       scenario_of("[tracker]\nrate_hz = " + std::to_string(rate) +
                                   "\n[robot]\nrate_hz = 125\n[[steps]]\ndo = \"wait\"\nduration_s = 9\n"),
                       4);
    const Recording run = play_for(room, 3.0, 1'000'000);
    EXPECT_NEAR(static_cast<double>(run.all.truths.size()), 3.0 * rate, 1.0);
    EXPECT_NEAR(static_cast<double>(run.all.robot_states.size()), 375, 1.0);
    EXPECT_NEAR(static_cast<double>(run.all.force_samples.size()), 600, 1.0);
    EXPECT_NEAR(static_cast<double>(run.all.range_samples.size()), 150, 1.0);
    for (const auto &frame : run.all.frames) {
      ASSERT_EQ(frame.period_ns, 1'000'000'000 / rate);
    }
    for (std::size_t i = 1; i < run.all.truths.size(); ++i) {
      ASSERT_NEAR(static_cast<double>(run.all.truths[i].time_ns - run.all.truths[i - 1].time_ns), 1e9 / rate, 1.0);
    }
  }
}

TEST(SimulatedRoom, DeliversAfterTheStatedDelayAndInOrder) {
  SimulatedRoom room(make_case(),
                     scenario_of("[tracker]\nrate_hz = 1000\ndelay_ms = 5\ndelay_jitter_ms = 2\n"
                                 "[[steps]]\ndo = \"wait\"\nduration_s = 9\n"),
                     4);
  const Recording run = play_for(room, 5.0, 250'000);
  double mean = 0.0;
  for (std::size_t i = 0; i < run.all.frames.size(); ++i) {
    const auto &frame = run.all.frames[i];
    const auto delay = frame.sent_time_ns - run.all.truths.at(frame.frame - 1).time_ns;
    ASSERT_GE(delay, 5'000'000);
    ASSERT_LE(frame.sent_time_ns, run.frame_arrivals_ns[i]);
    ASSERT_GT(frame.sent_time_ns, run.frame_arrivals_ns[i] - 250'001) << "given out as soon as it is due";
    if (i > 0) {
      ASSERT_EQ(frame.frame, run.all.frames[i - 1].frame + 1) << "nothing overtakes";
    }
    mean += static_cast<double>(delay) * 1e-6 / static_cast<double>(run.all.frames.size());
  }
  EXPECT_GT(mean, 6.5);
  EXPECT_LT(mean, 13.0) << "5 ms, 2 ms of jitter, and what the line holds back";
}

TEST(SimulatedRoom, LosesTheStatedShareOfFrames) {
  SimulatedRoom room(
      make_case(),
      scenario_of("[tracker]\nrate_hz = 1000\nmissing_share = 0.02\n[[steps]]\ndo = \"wait\"\nduration_s = 30\n"), 4);
  const Recording run = play_for(room, 10.0, 1'000'000);
  std::uint64_t lost = 0;
  for (std::size_t i = 1; i < run.all.frames.size(); ++i) {
    lost += run.all.frames[i].frame - run.all.frames[i - 1].frame - 1;
  }
  EXPECT_NEAR(static_cast<double>(lost), 200.0, 45.0) << "of 10,000: three sigma";
  EXPECT_EQ(run.all.frames.back().frame - run.all.frames.front().frame + 1 - lost, run.all.frames.size());
}

TEST(SimulatedRoom, GivesTheTimeOfTheNextEvent) {
  SimulatedRoom room(make_case(), scenario_of("[[steps]]\ndo = \"wait\"\nduration_s = 9\n"), 4);
  RoomOutput out;
  std::size_t frames = 0;
  std::int64_t now = kStart_ns;
  int calls = 0;
  for (; now < kStart_ns + 1'000'000'000; now = room.next_due_ns(), ++calls) {
    room.advance(now, out);
    frames += out.frames.size();
    ASSERT_GT(room.next_due_ns(), now);
    for (const auto &frame : out.frames) {
      ASSERT_EQ(frame.sent_time_ns, now) << "woken when it is due, not later";
    }
  }
  EXPECT_GT(frames, 245U);
  EXPECT_LT(calls, 1100);
}

// Truth and measurement differ only by the stated noise.
TEST(SimulatedRoom, TruthIsWhatTheTrackerMeasures) {
  const Recording run = short_run(4, 2'000'000);
  std::map<std::uint64_t, const wire::SimulatedTruth *> truth;
  for (const auto &sample : run.all.truths) {
    truth[sample.frame] = &sample;
  }
  double sum = 0.0;
  int count = 0;
  for (const auto &frame : run.all.frames) {
    ASSERT_TRUE(truth.contains(frame.frame));
    const auto *seen = find(frame, "Reference");
    sum += (translation(seen->T_tracker_tool) - translation(find(*truth[frame.frame], "Reference")->T_tracker_tool))
               .squaredNorm();
    ++count;
  }
  EXPECT_LT(std::sqrt(sum / count), 0.5);
  EXPECT_GT(std::sqrt(sum / count), 0.1);
}

} // namespace bregma::sim::test
