// The model with a probe: reasons, and conditions on every answer.
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "tests/support/allocation_counter.hpp"
#include "tests/support/tissue_insertions.hpp"
#include "tests/unit/tissue/guided_probe.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

// ---- reasons ----

void expect_reason(const BrainState &state, ModelStatus status, ModelReason reason) {
  EXPECT_EQ(name_of(state.status), name_of(status));
  EXPECT_EQ(sentence_of(state.reason), sentence_of(reason));
}

TEST(BrainModelReasons, AnUnseenProbeKeepsItsPoseAndIsInvalidAfterOneSecond) {
  Guided probe;
  probe.go_to(-15.0, 10.0);
  probe.wait(0.5);
  ASSERT_EQ(probe.model.state().status, ModelStatus::kValid);
  for (int i = 1; i < 50; ++i) {
    expect_reason(probe.update({}), ModelStatus::kExtrapolating, ModelReason::kProbeNotSeen);
  }
  probe.update({}); // at one second itself
  for (int i = 0; i < 50; ++i) {
    expect_reason(probe.update({}), ModelStatus::kInvalid, ModelReason::kProbeNotSeen);
  }
  EXPECT_EQ(probe.model.state().phase, Phase::kPenetration);
  probe.wait(0.3);
  EXPECT_EQ(probe.model.state().status, ModelStatus::kValid);
}

TEST(BrainModelReasons, AProbeIsFollowedAtMostAtTheMaximumSpeed) {
  Guided probe;
  probe.go_to(-1.0, 10.0);
  probe.height_mm -= 4.0; // in 0.02 s
  expect_reason(probe.update(probe.seen()), ModelStatus::kExtrapolating, ModelReason::kProbeJumped);
  EXPECT_NEAR(probe.model.probe().tip_mm.z(), kTop_mm - 1.0 - 100.0 * test::kUpdate_s, 1e-6);
}

TEST(BrainModelReasons, ARotationIsFollowedAtMostAtTheMaximumSpeed) {
  Guided probe;
  probe.go_to(-15.0, 10.0);
  ProbeObservation turned = probe.seen();
  turned.pose.shaft = -turned.pose.shaft;
  expect_reason(probe.update(turned), ModelStatus::kExtrapolating, ModelReason::kProbeJumped);
  EXPECT_NEAR(probe.model.probe().shaft.norm(), 1.0, 1e-9);
  EXPECT_GT(probe.model.probe().shaft.z(), 0.9);
}

TEST(BrainModelReasons, AJumpOutOfTheTissueIsReported) {
  Guided probe;
  probe.go_to(-15.0, 10.0);
  probe.height_mm = 60.0;
  const BrainState &state = probe.update(probe.seen());
  EXPECT_NE(state.status, ModelStatus::kValid);
  EXPECT_EQ(state.phase, Phase::kOutside);
}

TEST(BrainModelReasons, AProbeThatAppearsInsideHasAnUnknownPath) {
  Guided probe;
  probe.height_mm = -15.0;
  expect_reason(probe.update(probe.seen()), ModelStatus::kExtrapolating, ModelReason::kPathUnknown);
  expect_reason(probe.go_to(-18.0, 10.0), ModelStatus::kExtrapolating, ModelReason::kPathUnknown);
  probe.go_to(10.0, 20.0); // until it has left the tissue
  probe.wait(1.0);
  EXPECT_EQ(probe.model.state().status, ModelStatus::kValid);
}

TEST(BrainModelReasons, TooFewStepsForTheClockAreTooSlow) {
  Guided probe;
  probe.go_to(-15.0, 10.0);
  probe.wait(0.5);
  expect_reason(probe.update(probe.seen(), 2), ModelStatus::kExtrapolating, ModelReason::kTooSlow);
  EXPECT_EQ(probe.model.state().steps, 2);
  EXPECT_GT(probe.model.state().behind_s, 0.5 * test::kUpdate_s);
  expect_reason(probe.update(probe.seen(), 0), ModelStatus::kExtrapolating, ModelReason::kTooSlow);
  EXPECT_EQ(probe.model.state().steps, 0);
}

TEST(BrainModelReasons, AProbeThatExitsOnTheFarSideHasLeftTheMesh) {
  Guided probe;
  probe.go_to(-kTop_mm - 5.0, 20.0);
  expect_reason(probe.model.state(), ModelStatus::kInvalid, ModelReason::kProbeLeftMesh);
}

TEST(BrainModelReasons, AProbeThatAppearsAcrossTheBrainHasLeftTheMesh) {
  Guided probe;
  ProbeObservation across = probe.seen();
  across.pose.tip_mm = {-3.0, 30.3, kTop_mm - 2.0};
  across.pose.shaft = Vector3d(1.0, 0.02, 0.0).normalized();
  for (int i = 0; i < 10; ++i) {
    expect_reason(probe.update(across), ModelStatus::kInvalid, ModelReason::kProbeLeftMesh);
  }
  EXPECT_EQ(probe.largest_mm(), 0.0);
  probe.go_to(-15.0, 10.0); // then from above
  probe.wait(0.5);
  EXPECT_EQ(probe.model.state().status, ModelStatus::kValid);
}

TEST(BrainModelReasons, RejectedStepsAreRolledBackAndThenResetToRest) {
  Guided probe;
  // The shaft appears lying on the surface, half of it in the tissue.
  ProbeObservation lying = probe.seen();
  lying.pose.tip_mm = {15.0, 30.3, kTop_mm + 0.05};
  lying.pose.shaft = Vector3d::UnitX();
  std::set<ModelReason> reasons;
  for (int i = 0; i < 30; ++i) {
    const BrainState &state = probe.update(lying);
    EXPECT_NE(state.status, ModelStatus::kValid) << i;
    reasons.insert(state.reason);
  }
  EXPECT_TRUE(reasons.contains(ModelReason::kStepRejected));
  EXPECT_TRUE(reasons.contains(ModelReason::kDiverged));
  probe.height_mm = 80.0;
  probe.wait(2.0);
  EXPECT_EQ(probe.model.state().status, ModelStatus::kValid);
  EXPECT_LT(probe.largest_mm(), 0.1);
}

TEST(BrainModelReasons, ResidualVibrationIsSettling) {
  BrainModelOptions options = in_an_opening();
  options.solver.damping_per_s = 2.0;
  options.insertion.cutting_force_N = 0.0;
  Guided probe(options);
  std::set<ModelReason> reasons;
  while (probe.height_mm > -20.0) {
    probe.go_to(probe.height_mm - 0.5, 25.0);
    reasons.insert(probe.model.state().reason);
  }
  EXPECT_TRUE(reasons.contains(ModelReason::kSettling)); // after the rupture
}

// The bound includes the residual vibration.
TEST(BrainModelReasons, VibrationBelowTrackerNoiseIsNotSettling) {
  for (const double vibration_mm : {0.1, 3.0}) {
    BrainModel model(block(), {}, in_an_opening());
    const int middle = model.solver().nodes() / 2;
    model.solver().set_displacement_mm(middle, {vibration_mm, 0.0, 0.0});
    bool settling = false;
    double vibration = 0.0;
    ModelVerdict verdict;
    for (int update = 0; update < 20; ++update) {
      verdict.begin_update();
      model.solver().advance(3);
      verdict.commit_or_roll_back(model.solver(), test::kUpdate_s);
      settling = settling || verdict.reason() == ModelReason::kSettling;
      vibration = std::max(vibration, verdict.residual_vibration());
    }
    EXPECT_EQ(settling, vibration_mm > 1.0) << vibration_mm;
    EXPECT_GT(vibration, 0.5);
  }
}

TEST(BrainModelReasons, EveryReasonHasItsSentenceAndEveryPhaseAndStatusItsName) {
  std::set<std::string_view> sentences;
  for (int i = 0; i <= static_cast<int>(ModelReason::kDiverged); ++i) {
    sentences.insert(sentence_of(static_cast<ModelReason>(i)));
  }
  EXPECT_EQ(sentences.size(), static_cast<std::size_t>(ModelReason::kDiverged) + 1);
  EXPECT_EQ(name_of(Phase::kWithdrawal), "withdrawal");
  EXPECT_EQ(name_of(ModelStatus::kExtrapolating), "extrapolating");
}

// ---- inputs of an update ----

TEST(BrainModelInputs, AnInvalidPoseCountsAsNotSeen) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int kind = 0; kind < 4; ++kind) {
    Guided probe;
    probe.go_to(-15.0, 10.0);
    ProbeObservation wrong = probe.seen();
    if (kind == 0) {
      wrong.pose.tip_mm.x() = nan;
    } else if (kind == 1) {
      wrong.pose.shaft.z() = std::numeric_limits<double>::infinity();
    } else if (kind == 2) {
      wrong.pose.shaft.setZero();
    } else {
      wrong.pose.tip_mm.setConstant(nan);
      wrong.pose.shaft.setConstant(nan);
    }
    expect_reason(probe.update(wrong), ModelStatus::kExtrapolating, ModelReason::kProbeNotSeen);
    EXPECT_TRUE(probe.model.solver().finite());
    EXPECT_EQ(probe.model.state().phase, Phase::kPenetration);
    EXPECT_EQ(probe.model.state().ruptures, 1);
  }
}

TEST(BrainModelInputs, TheShaftsDirectionIsNormalised) {
  Guided probe;
  probe.go_to(-15.0, 10.0);
  probe.wait(0.5);
  ProbeObservation longer = probe.seen();
  longer.pose.shaft *= 5.0;
  EXPECT_EQ(probe.update(longer).status, ModelStatus::kValid);
  EXPECT_NEAR(probe.model.probe().shaft.norm(), 1.0, 1e-9);
}

TEST(BrainModelInputs, AForceThatIsNotFiniteIsIgnored) {
  Guided probe;
  probe.go_to(-4.0, 10.0);
  ProbeObservation wrong = probe.seen();
  wrong.force_N = std::numeric_limits<double>::quiet_NaN();
  probe.update(wrong);
  EXPECT_EQ(probe.model.state().stiffness_scale, 1.0);
  probe.go_to(-15.0, 10.0);
  wrong = probe.seen();
  wrong.force_N = std::numeric_limits<double>::infinity();
  probe.update(wrong);
  probe.wait(0.1);
  EXPECT_TRUE(std::isfinite(probe.model.state().tip_force_N));
}

TEST(BrainModelInputs, ZeroElapsedTimeDoesNotMoveTheProbe) {
  Guided probe;
  probe.go_to(-15.0, 10.0);
  const Vector3d before_mm = probe.model.probe().tip_mm;
  probe.height_mm -= 1.0;
  for (const double elapsed_s : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
    (void)probe.model.update(probe.seen(), elapsed_s, test::kManySteps);
    EXPECT_EQ(probe.model.probe().tip_mm, before_mm);
    EXPECT_TRUE(probe.model.solver().finite());
  }
  EXPECT_EQ(probe.update(probe.seen(), -5).steps, 0);
}

TEST(BrainModelInputs, NoUpdateAllocates) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "a sanitizer counts for itself";
  }
  Guided probe;
  const auto update = [&](const ProbeObservation &seen) {
    (void)probe.model.update(seen, test::kUpdate_s, test::kManySteps);
  };
  const test::AllocationScope scope;
  for (double height_mm = 10.0; height_mm > -20.0; height_mm -= 0.4) {
    probe.height_mm = height_mm;
    update(probe.seen());
  }
  update({});
  for (double height_mm = -20.0; height_mm < 10.0; height_mm += 0.4) {
    probe.height_mm = height_mm;
    update(probe.seen());
  }
  probe.height_mm = -10.0; // a jump inside
  update(probe.seen());
  probe.model.reset();
  EXPECT_EQ(scope.count(), 0U);
}

TEST(BrainModelInputs, TargetsInsideAreFollowedAndThoseOutsideAreNot) {
  Guided probe;
  probe.go_to(-8.0, 10.0);
  ASSERT_TRUE(probe.model.points()[0].inside);
  EXPECT_LT(probe.model.points()[0].displacement_mm.z(), -0.05); // pushed ahead of the tip
  EXPECT_GT(probe.model.points()[0].error_bound_mm, 0.0);
  EXPECT_GT(probe.model.points()[0].von_mises_Pa, 0.0);
  EXPECT_FALSE(probe.model.points()[1].inside);
  probe.model.reset();
  EXPECT_EQ(probe.model.points()[0].displacement_mm.norm(), 0.0);
}

TEST(BrainModelRefusals, AreReportedWithTheReason) {
  const auto refusal = [](auto &&spoil) -> std::string {
    BrainModelOptions options = in_an_opening();
    spoil(options);
    try {
      const BrainModel model(block(), {}, options);
    } catch (const std::invalid_argument &error) {
      return error.what();
    }
    return "";
  };
  using O = BrainModelOptions;
  EXPECT_EQ(refusal([](O &o) { o.probe.radius_mm = 0.0; }), "probe.radius_mm = 0.000000, must be positive");
  EXPECT_EQ(refusal([](O &o) { o.insertion.rupture_force_N = -1.0; }),
            "insertion.rupture_force_N = -1.000000, must be positive");
  EXPECT_EQ(refusal([](O &o) { o.max_probe_speed_mm_s = NAN; }), "max_probe_speed_mm_s = nan, must be positive");
  EXPECT_EQ(refusal([](O &o) { o.insertion.cutting_force_N = -0.5; }),
            "insertion: a cutting or friction force of -0.500000, must not be negative");
}

// ---- random insertions ----

// bench_tissue --only robustness runs 200 insertions into 20,000 tetrahedra.
TEST(BrainModelRobustness, RandomInsertionsNeverGiveAWrongValidAnswer) {
  constexpr std::uint32_t kFirstSeed = 20;
  constexpr std::uint32_t kInsertions = 6;
  std::printf("seeds %u to %u\n", kFirstSeed, kFirstSeed + kInsertions - 1);
  const BrainModelOptions options = in_an_opening();
  BrainModel model(block(), std::vector<Vector3d>{kEntry_mm - Vector3d(0.0, 0.0, 20.0)}, options);
  const test::InsertionSite site{
      .entry_mm = kEntry_mm, .outward = Vector3d::UnitZ(), .aside_mm = 10.0, .deepest_mm = 30.0};
  test::InsertionFindings all;
  for (std::uint32_t seed = kFirstSeed; seed < kFirstSeed + kInsertions; ++seed) {
    all.add(test::insert_at_random(model, site, test::physical_bounds(options), seed));
  }
  EXPECT_GT(all.valid, all.updates / 2); // otherwise the test checks nothing
  EXPECT_EQ(all.failures(), 0);
  for (const std::string &example : all.examples) {
    ADD_FAILURE() << example;
  }
}

} // namespace
} // namespace bregma::tissue
