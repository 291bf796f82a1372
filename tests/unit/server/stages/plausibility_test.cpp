// The plausibility of tracked bodies, each test alone and the attribution of jumps.
#include "server/stages/plausibility/frame_judge.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

namespace bregma::server {
namespace {

using geometry::Vector3d;
using Content = BodyFrame::Content;

constexpr std::int64_t kLimit_ns = 100'000'000;
constexpr double kSigma_mm = 0.5;

// A reference at rest in the tracker and one tool that moves in Reference, seen by a tracker of the given rate.
class Room {
public:
  explicit Room(double rate_hz = 250.0) : period_ns_(static_cast<std::int64_t>(1e9 / rate_hz)) { judge.guard(true); }

  BodyFrame body(const Vector3d &point, const Eigen::Quaterniond &rotation = Eigen::Quaterniond::Identity()) {
    std::normal_distribution<double> normal(0.0, kSigma_mm);
    BodyFrame out;
    out.content = Content::kNew;
    out.markers = 4;
    out.volume = 0.8;
    out.residual_mm = out.expected_residual_mm = 0.2;
    out.sample = {time_ns_, point + Vector3d(normal(rng_), normal(rng_), normal(rng_)), 3.0 * kSigma_mm * kSigma_mm,
                  rotation, 1e-5};
    out.placed = true;
    return out;
  }
  void step(const BodyFrame &reference, const BodyFrame &tool) {
    judge.judge(reference, std::array{tool}, kLimit_ns);
    time_ns_ += period_ns_;
  }
  void rest(int frames) {
    for (int i = 0; i < frames; ++i) {
      step(body(kReference), body(kTool));
    }
  }
  [[nodiscard]] double time_s() const { return 1e-9 * static_cast<double>(time_ns_); }
  void pass(std::int64_t time_ns) { time_ns_ += time_ns; }

  static inline const Vector3d kReference{0, 0, 1600}, kTool{100, 50, 20};
  FrameJudge judge;

private:
  std::int64_t period_ns_;
  std::int64_t time_ns_ = 1'000'000'000;
  std::mt19937 rng_{5};
};

TEST(Plausibility, AHandOfUpToTwoMetresPerSecondIsTrustedAt60HzAndMore) {
  for (const double rate_hz : {60.0, 250.0, 1000.0}) {
    Room room(rate_hz);
    double largest = 0.0;
    for (int i = 0; i < static_cast<int>(20.0 * rate_hz); ++i) {
      // Strokes of 0.4 m, peaks of 2 m/s and 20 m/s^2, and turns of up to 12 rad/s.
      const double phase = 2.0 * std::numbers::pi * 1.6 * room.time_s();
      const auto turn = Eigen::AngleAxisd(1.2 * std::sin(phase), Vector3d(1, 2, 2) / 3.0);
      const BodyFrame tool = room.body(Room::kTool + Vector3d(199.0 * std::sin(phase), 0, 0), Eigen::Quaterniond(turn));
      largest = std::max(largest, room.judge.tool(0).motion(tool.sample).statistic());
      room.step(room.body(Room::kReference), tool);
      ASSERT_TRUE(room.judge.trusted(0)) << rate_hz << " Hz, frame " << i;
    }
    EXPECT_LT(largest, 0.8 * Motion::kThreshold) << rate_hz << " Hz";
  }
}

TEST(Plausibility, AToolThatJumpsIsRefusedAtOnceAndForAsLongAsItStaysThere) {
  for (const double rate_hz : {60.0, 250.0}) {
    Room room(rate_hz);
    room.rest(50);
    for (int i = 0; i < 2000; ++i) {
      room.step(room.body(Room::kReference), room.body(Room::kTool + Vector3d(0, 100, 0)));
      ASSERT_FALSE(room.judge.trusted(0)) << rate_hz << " Hz, frame " << i;
    }
    const Judgement judgement = room.judge.judgement(0);
    EXPECT_EQ(judgement.plausibility, bregma_wire_PLAUSIBILITY_REFUSED);
    EXPECT_EQ(judgement.reason, bregma_wire_IMPLAUSIBLE_JUMP);
    EXPECT_GT(judgement.statistic, judgement.threshold);
    EXPECT_TRUE(room.judge.steady(0)) << "a check touch may show where it is";
    room.rest(BodyJudge::kConsistentFrames - 1);
    EXPECT_FALSE(room.judge.trusted(0));
    room.rest(1);
    EXPECT_TRUE(room.judge.trusted(0)) << "back where a hand can have carried it, for the required frames";
    EXPECT_EQ(room.judge.tool(0).refusals(), 1U);
  }
}

TEST(Plausibility, AToolThatWasHiddenForASecondBeginsAgain) {
  Room room;
  room.rest(50);
  const Vector3d elsewhere = Room::kTool + Vector3d(0, 300, 0);
  room.step(room.body(Room::kReference), room.body(elsewhere));
  EXPECT_FALSE(room.judge.trusted(0));
  room.pass(1'100'000'000);
  for (int i = 0; i < BodyJudge::kConsistentFrames; ++i) {
    EXPECT_FALSE(room.judge.trusted(0));
    room.step(room.body(Room::kReference), room.body(elsewhere));
  }
  EXPECT_TRUE(room.judge.trusted(0));
}

TEST(Plausibility, ARotationThatTurnsOverIsNamedAsOne) {
  Room room;
  room.rest(50);
  const Eigen::Quaterniond transposed(Eigen::AngleAxisd(0.5, Vector3d::UnitX()));
  room.step(room.body(Room::kReference), room.body(Room::kTool, transposed));
  EXPECT_EQ(room.judge.judgement(0).reason, bregma_wire_IMPLAUSIBLE_ROTATION);
}

TEST(Plausibility, AReferenceThatIsElsewhereAfterItWasHiddenNeedsACheckTouch) {
  for (const std::int64_t hidden_ns : {150'000'000LL, 900'000'000LL, 60'000'000'000LL}) {
    Room room;
    room.rest(50);
    room.pass(hidden_ns);
    for (int i = 0; i < 500; ++i) {
      room.step(room.body(Room::kReference + Vector3d(12, 0, 0)), BodyFrame{});
    }
    EXPECT_FALSE(room.judge.trusted(0)) << hidden_ns;
    EXPECT_EQ(room.judge.reference_judgement().reason, bregma_wire_IMPLAUSIBLE_DISPLACED);
    room.judge.confirm(0);
    EXPECT_TRUE(room.judge.trusted(0));
  }
}

TEST(Plausibility, AReferenceThatWasHiddenAndIsWhereItWasIsTrusted) {
  Room room;
  for (int i = 0; i < 2000; ++i) {
    room.rest(5);
    room.pass(150'000'000LL * (1 + i % 10));
  }
  room.rest(BodyJudge::kConsistentFrames);
  EXPECT_TRUE(room.judge.trusted(0));
  EXPECT_EQ(room.judge.reference().refusals(), 0U);
}

TEST(Plausibility, AMovedCameraIsNoDisplacementWhileAToolIsSeenInReference) {
  Room room;
  room.rest(50);
  room.pass(300'000'000);
  room.step(room.body(Room::kReference + Vector3d(0, 80, 40)), room.body(Room::kTool));
  EXPECT_TRUE(room.judge.trusted(0));
}

TEST(Plausibility, AJumpOfTheReferenceIsNotTheToolsAndEndsOnlyByACheckTouch) {
  Room room;
  room.rest(50);
  const Vector3d knocked(60, 0, 0);
  for (int i = 0; i < 2; ++i) {
    room.step(room.body(Room::kReference + knocked), room.body(Room::kTool - knocked));
  }
  EXPECT_EQ(room.judge.tool(0).refusals(), 0U);
  room.rest(500); // back
  EXPECT_FALSE(room.judge.trusted(0));
  EXPECT_EQ(room.judge.reference_judgement().reason, bregma_wire_IMPLAUSIBLE_JUMP);
  EXPECT_TRUE(room.judge.steady(0));
  room.judge.confirm(0);
  EXPECT_TRUE(room.judge.trusted(0));
  EXPECT_EQ(room.judge.judgement(0).plausibility, bregma_wire_PLAUSIBILITY_GOOD);
}

TEST(Plausibility, WithoutARegistrationARefusedReferenceRecoversByItself) {
  Room room;
  room.judge.guard(false);
  room.rest(50);
  room.step(room.body(Room::kReference + Vector3d(60, 0, 0)), room.body(Room::kTool - Vector3d(60, 0, 0)));
  EXPECT_FALSE(room.judge.trusted(0));
  room.rest(BodyJudge::kConsistentFrames);
  EXPECT_TRUE(room.judge.trusted(0));
}

TEST(Plausibility, AMovedCameraIsNoJumpWhileToolsAreSeenInReference) {
  Room room;
  room.rest(50);
  room.step(room.body(Room::kReference + Vector3d(0, 80, 40)), room.body(Room::kTool));
  EXPECT_TRUE(room.judge.trusted(0));
}

TEST(Plausibility, ARepeatedPoseIsRefusedAfterTheLimit) {
  Room room;
  room.rest(50);
  BodyFrame repeated = room.body(Room::kTool);
  repeated.content = Content::kRepeated;
  for (repeated.repeated_ns = 4'000'000; repeated.repeated_ns < kLimit_ns; repeated.repeated_ns += 4'000'000) {
    room.step(room.body(Room::kReference), repeated);
    EXPECT_TRUE(room.judge.trusted(0)) << "a few equal poses are possible: their age ends the pose";
  }
  room.step(room.body(Room::kReference), repeated);
  EXPECT_EQ(room.judge.judgement(0).reason, bregma_wire_IMPLAUSIBLE_FROZEN);
  room.rest(BodyJudge::kConsistentFrames);
  EXPECT_TRUE(room.judge.trusted(0));
}

TEST(Plausibility, APositionOutsideTheVolumeIsRefused) {
  Room room;
  room.rest(50);
  BodyFrame outside = room.body(Room::kTool);
  for (const double volume : {1.01, std::nan("")}) {
    outside.volume = volume;
    room.step(room.body(Room::kReference), outside);
    EXPECT_EQ(room.judge.judgement(0).reason, bregma_wire_IMPLAUSIBLE_VOLUME);
    room.rest(BodyJudge::kConsistentFrames);
    EXPECT_TRUE(room.judge.trusted(0));
  }
}

TEST(Plausibility, AResidualFirstInflatesTheCovarianceAndIsThenRefused) {
  Room room;
  const auto with_residual = [&room](double relative) {
    BodyFrame out = room.body(Room::kTool);
    out.residual_mm = relative * out.expected_residual_mm;
    return out;
  };
  room.rest(50);
  EXPECT_EQ(room.judge.tool(0).inflation(), 1.0);
  for (int i = 0; i < 50; ++i) {
    room.step(room.body(Room::kReference), with_residual(2.0));
  }
  EXPECT_EQ(room.judge.judgement(0).plausibility, bregma_wire_PLAUSIBILITY_INFLATED);
  EXPECT_NEAR(room.judge.tool(0).inflation(), 4.0, 0.1);
  EXPECT_TRUE(room.judge.trusted(0));
  room.rest(50);
  int frames = 0;
  for (; room.judge.trusted(0); ++frames) {
    room.step(room.body(Room::kReference), with_residual(3.0));
  }
  EXPECT_LE(frames, 5) << "5 frames at 60 Hz are less than the limit of 100 ms";
  EXPECT_EQ(room.judge.judgement(0).reason, bregma_wire_IMPLAUSIBLE_RESIDUAL);
  room.rest(50);
  room.step(room.body(Room::kReference), with_residual(250.0));
  EXPECT_FALSE(room.judge.trusted(0)) << "50 mm are refused at once";
}

TEST(Plausibility, ResidualsOfTheExpectedSizeAreNeverRefused) {
  std::mt19937 rng(11);
  std::normal_distribution<double> normal;
  std::uint64_t refused = 0;
  for (int seed = 0; seed < 100; ++seed) {
    BodyJudge judge;
    for (int i = 0; i < 10'000; ++i) { // three markers: three degrees of freedom
      const double chi = std::sqrt(std::pow(normal(rng), 2) + std::pow(normal(rng), 2) + std::pow(normal(rng), 2));
      judge.residual(chi, std::sqrt(3.0));
    }
    refused += judge.refusals();
  }
  EXPECT_EQ(refused, 0U) << "of a million frames";
}

TEST(Plausibility, AMalformedFrameOfTheReferenceNeedsNoCheckTouch) {
  Room room;
  room.rest(50);
  BodyFrame malformed;
  malformed.content = Content::kMalformed;
  malformed.markers = 2;
  room.step(malformed, room.body(Room::kTool));
  EXPECT_EQ(room.judge.judgement(0).reason, bregma_wire_IMPLAUSIBLE_MARKERS);
  EXPECT_EQ(room.judge.judgement(0).statistic, 2.0);
  room.rest(BodyJudge::kConsistentFrames);
  EXPECT_TRUE(room.judge.trusted(0));
}

} // namespace
} // namespace bregma::server
