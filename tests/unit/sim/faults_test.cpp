// Every fault has its effect at its time, and no other effect.
#include <gtest/gtest.h>

#include <cmath>

#include "idl/names.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim::test {

namespace {

using Eigen::Vector3d;

constexpr std::uint64_t kSeed = 21;
const std::string kWait = "[[steps]]\ndo = \"wait\"\nduration_s = 4\n";

Recording run_with(const std::string &fault, double seconds = 4.0) {
  SimulatedRoom room(make_case(), scenario_of("[tracker]\nrate_hz = 100\n" + kWait + fault), kSeed);
  return play_for(room, seconds, 1'000'000);
}

double exposed_s(const Recording &run, std::uint64_t frame) {
  return static_cast<double>(run.all.truths.at(frame - 1).time_ns - kStart_ns) * 1e-9;
}

} // namespace

TEST(Faults, OcclusionHidesOneToolForItsTime) {
  const Recording run =
      run_with("[[faults]]\nkind = \"occlusion\"\ntool = \"Stylus\"\nafter_s = 1\nduration_s = 0.5\n");
  int hidden = 0;
  for (const auto &frame : run.all.frames) {
    const double at = exposed_s(run, frame.frame);
    const bool covered = at >= 1.0 && at < 1.5;
    EXPECT_EQ(find(frame, "Stylus")->status, covered ? bregma_wire_TOOL_HIDDEN : bregma_wire_TOOL_VISIBLE) << at;
    EXPECT_EQ(find(frame, "Reference")->status, bregma_wire_TOOL_VISIBLE) << at;
    hidden += covered ? 1 : 0;
  }
  EXPECT_EQ(hidden, 50);
}

TEST(Faults, ASilentTrackerLeavesAGapInTheNumbers) {
  const Recording run =
      run_with("[[faults]]\nkind = \"tracker_silent\"\nstep = \"wait\"\nafter_s = 2\nduration_s = 0.75\n");
  std::uint64_t gap = 0;
  for (std::size_t i = 1; i < run.all.frames.size(); ++i) {
    const std::uint64_t step = run.all.frames[i].frame - run.all.frames[i - 1].frame;
    if (step > 1) {
      EXPECT_EQ(gap, 0U) << "one gap only";
      gap = step - 1;
      EXPECT_NEAR(exposed_s(run, run.all.frames[i].frame), 2.75, 0.011);
    }
  }
  EXPECT_EQ(gap, 75U);
  EXPECT_GT(run.all.robot_states.size(), 390U) << "the others go on";
}

TEST(Faults, ABumpMovesTheReferenceAgainstTheHead) {
  const Recording run = run_with("[[faults]]\nkind = \"reference_bump\"\nafter_s = 1\n"
                                 "[[faults]]\nkind = \"reference_bump\"\nafter_s = 2\nvector_mm = [0.0, 3.0, 0.0]\n");
  const auto &truths = run.all.truths;
  const auto reference = [&truths](std::size_t frame) { return translation(truths.at(frame).T_image_reference); };
  EXPECT_EQ(reference(0), reference(99));
  EXPECT_NEAR((reference(101) - reference(98)).norm(), 2.0, 1e-9) << "magnitude by default, direction of the seed";
  EXPECT_NEAR((reference(201) - reference(150) - Vector3d(0, 3, 0)).norm(), 0.0, 1e-9);
  // The tracker measures the same displacement of the reference's body in its frame.
  Vector3d before = Vector3d::Zero();
  Vector3d after = Vector3d::Zero();
  for (const auto &frame : run.all.frames) {
    const Vector3d seen = translation(find(frame, "Reference")->T_tracker_tool);
    before += exposed_s(run, frame.frame) < 1.0 ? Vector3d(seen / 100.0) : Vector3d(Vector3d::Zero());
    const double at = exposed_s(run, frame.frame);
    after += at >= 1.0 && at < 2.0 ? Vector3d(seen / 100.0) : Vector3d(Vector3d::Zero());
  }
  EXPECT_NEAR((after - before).norm(), 2.0, 0.15);
}

TEST(Faults, AClockJumpStays) {
  const Recording run = run_with("[[faults]]\nkind = \"clock_jump\"\nafter_s = 1\njump_ms = -80\n");
  for (const auto &frame : run.all.frames) {
    const auto &truth = run.all.truths.at(frame.frame - 1);
    const double off_ms = static_cast<double>(frame.device_time_ns - truth.time_ns) * 1e-6;
    EXPECT_NEAR(off_ms, exposed_s(run, frame.frame) < 1.0 ? 1500.0 : 1420.0, 0.3);
  }
}

TEST(Faults, AFloodMultipliesOneDevicesRate) {
  const Recording run =
      run_with("[[faults]]\nkind = \"flood\"\nafter_s = 1\nduration_s = 1\n"
               "[[faults]]\nkind = \"flood\"\ndevice = \"Force\"\nafter_s = 3\nduration_s = 0.5\nfactor = 4\n");
  EXPECT_NEAR(static_cast<double>(run.all.frames.size()), 300 + 1000, 12);
  for (std::size_t i = 1; i < run.all.frames.size(); ++i) {
    EXPECT_EQ(run.all.frames[i].frame, run.all.frames[i - 1].frame + 1) << "whole and in order";
    EXPECT_EQ(run.all.frames[i].period_ns, 10'000'000) << "as the device states it";
  }
  EXPECT_NEAR(static_cast<double>(run.all.force_samples.size()), 700 + 400, 6);
  EXPECT_NEAR(static_cast<double>(run.all.robot_states.size()), 400, 2);
}

TEST(Faults, FaultySamplesHaveTheNamedFault) {
  const auto run = [](const std::string &sample) {
    return run_with("[[faults]]\nkind = \"bad_samples\"\nsample = \"" + sample + "\"\ncount = 7\nafter_s = 1\n", 2.0);
  };
  const Recording clean = run_with("", 2.0);
  const auto differing = [&clean](const Recording &bad) { // frames that differ from those of the run without faults
    std::vector<wire::TrackerFrame> out;
    std::map<std::uint64_t, int> seen;
    for (const auto &frame : bad.all.frames) {
      const auto &good = clean.all.frames.at(frame.frame - 1);
      if (!same_bytes(&frame, &good, sizeof(frame)) || seen[frame.frame]++ > 0) {
        out.push_back(frame);
      }
    }
    return out;
  };
  const auto all = [&](const std::string &sample, std::size_t total, auto &&is_so) {
    const Recording bad = run(sample);
    EXPECT_EQ(bad.all.frames.size(), total) << sample;
    const auto found = differing(bad);
    EXPECT_EQ(found.size(), 7U) << sample;
    for (const auto &frame : found) {
      EXPECT_TRUE(is_so(frame, clean.all.frames.at(frame.frame - 1))) << sample << " frame " << frame.frame;
    }
  };
  using Frame = wire::TrackerFrame;
  const std::size_t n = clean.all.frames.size();
  all("not_finite", n,
      [](const Frame &f, const Frame &) { return !translation(f.tools[0].T_tracker_tool).allFinite(); });
  all("not_a_rotation", n,
      [](const Frame &f, const Frame &) { return f.tools[0].T_tracker_tool.rotation_wxyz[0] > 1.1; });
  all("time_backwards", n,
      [](const Frame &f, const Frame &g) { return f.device_time_ns == g.device_time_ns - 1'000'000'000; });
  all("time_in_future", n,
      [](const Frame &f, const Frame &g) { return f.device_time_ns > g.device_time_ns + 3'000'000'000'000; });
  all("unknown_tool", n, [](const Frame &f, const Frame &) { return wire::view(f.tools[0].tool) == "Stranger"; });
  all("malformed", n, [](const Frame &f, const Frame &) { return f.tool_count > bregma_wire_MAX_TOOLS; });
  all("duplicate", n + 7, [](const Frame &f, const Frame &g) { return same_bytes(&f, &g, sizeof(f)); });
  all("unknown_device", n + 7, [](const Frame &f, const Frame &) { return wire::view(f.device) == "Stranger"; });
}

TEST(Faults, DoNotChangeOtherEvents) {
  const Recording clean = run_with("");
  const Recording occluded =
      run_with("[[faults]]\nkind = \"occlusion\"\ntool = \"Stylus\"\nafter_s = 1\nduration_s = 0.5\n");
  ASSERT_EQ(clean.all.frames.size(), occluded.all.frames.size());
  for (std::size_t i = 0; i < clean.all.frames.size(); ++i) {
    EXPECT_EQ(translation(find(clean.all.frames[i], "Reference")->T_tracker_tool),
              translation(find(occluded.all.frames[i], "Reference")->T_tracker_tool));
  }
}

} // namespace bregma::sim::test
