// The model during insertion and withdrawal of a probe: phases and forces.
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/unit/tissue/guided_probe.hpp"

namespace bregma::tissue {
namespace {

TEST(BrainModelPhases, AreSequentialAndTheTissueReturnsToRest) {
  Guided probe;
  probe.go_to(5.0, 20.0);
  EXPECT_EQ(probe.model.state().status, ModelStatus::kValid);
  EXPECT_EQ(probe.largest_mm(), 0.0);
  probe.go_to(-3.0, 10.0);
  EXPECT_EQ(probe.model.state().phase, Phase::kIndentation);
  EXPECT_EQ(probe.model.state().ruptures, 0);
  EXPECT_NEAR(probe.model.state().depth_mm, 3.0, 0.3); // depth of the indentation
  EXPECT_GT(probe.model.state().tip_force_N, 0.01);
  probe.go_to(-25.0, 10.0);
  EXPECT_EQ(probe.model.state().phase, Phase::kPenetration);
  EXPECT_EQ(probe.model.state().ruptures, 1);
  EXPECT_NEAR(probe.model.state().rupture_force_N, InsertionParameters{}.rupture_force_N, 0.01);
  EXPECT_NEAR(probe.model.state().depth_mm, 25.0, 6.0);
  probe.go_to(10.0, 10.0);
  EXPECT_EQ(probe.model.state().phase, Phase::kOutside);
  EXPECT_EQ(probe.model.state().depth_mm, 0.0);
  probe.wait(2.0);
  EXPECT_LT(probe.largest_mm(), 0.1);
  EXPECT_EQ(probe.model.state().status, ModelStatus::kValid);
  EXPECT_EQ(probe.phases, (std::vector{Phase::kOutside, Phase::kIndentation, Phase::kPenetration, Phase::kWithdrawal,
                                       Phase::kOutside}));
}

TEST(BrainModelPhases, ATouchWithoutRuptureIsResetWhenTheProbeLeaves) {
  Guided probe;
  probe.go_to(-3.0, 10.0);
  probe.go_to(10.0, 10.0);
  probe.wait(1.0);
  EXPECT_EQ(probe.phases, (std::vector{Phase::kOutside, Phase::kIndentation, Phase::kOutside}));
  EXPECT_EQ(probe.model.state().ruptures, 0);
  EXPECT_LT(probe.largest_mm(), 0.05);
}

TEST(BrainModelPhases, TremorDoesNotChangeThePhase) {
  Guided probe;
  probe.go_to(-15.0, 10.0);
  for (int i = 0; i < 50; ++i) {
    probe.height_mm += i % 2 == 0 ? 0.2 : -0.2;
    probe.update(probe.seen());
    EXPECT_EQ(probe.model.state().phase, Phase::kPenetration);
  }
}

// A hand's tremor of 0.1 mm (standard deviation per coordinate) at about 10 Hz and equal tracker noise, without the
// navigation's filter. The tissue may be reported as settling, but not most of the time.
TEST(BrainModelPhases, AProbeHeldByAHandIsFollowed) {
  Guided probe;
  probe.go_to(-25.0, 10.0);
  probe.wait(0.5);
  std::mt19937 random(1);
  std::normal_distribution<double> noise_mm(0.0, 0.1);
  int valid = 0;
  constexpr int kUpdates = 300;
  for (int i = 0; i < kUpdates; ++i) {
    ProbeObservation held = probe.seen();
    for (int c = 0; c < 3; ++c) {
      held.pose.tip_mm[c] += 0.14 * std::sin((58.0 + 5.0 * c) * i * test::kUpdate_s + c) + noise_mm(random);
    }
    probe.update(held);
    EXPECT_NE(probe.model.state().status, ModelStatus::kInvalid) << i;
    valid += probe.model.state().status == ModelStatus::kValid ? 1 : 0;
  }
  EXPECT_GT(valid, kUpdates * 6 / 10);
}

TEST(BrainModelPhases, TheRuptureForceDeterminesTheRupture) {
  double before_mm = 0.0;
  for (const double force_N : {0.03, 0.06, 0.12}) {
    BrainModelOptions options = in_an_opening();
    options.insertion.rupture_force_N = force_N;
    Guided probe(options);
    while (probe.model.state().ruptures == 0 && probe.height_mm > -20.0) {
      probe.go_to(probe.height_mm - 0.1, 5.0);
    }
    ASSERT_EQ(probe.model.state().ruptures, 1);
    EXPECT_NEAR(probe.model.state().rupture_force_N, force_N, 0.1 * force_N);
    EXPECT_GT(-probe.height_mm, before_mm);
    before_mm = -probe.height_mm;
  }
}

TEST(BrainModelPhases, AStressLimitCanRuptureTheSurface) {
  BrainModelOptions options = in_an_opening();
  options.insertion.rupture_force_N = 100.0;
  options.insertion.rupture_stress_Pa = 600.0;
  Guided probe(options);
  probe.go_to(-10.0, 5.0);
  EXPECT_EQ(probe.model.state().ruptures, 1);
  EXPECT_LT(probe.model.state().rupture_force_N, 1.0);
}

TEST(BrainModelPhases, AnExistingHoleIsEnteredWithoutASecondRupture) {
  Guided probe;
  probe.go_to(-20.0, 10.0);
  probe.go_to(10.0, 10.0);
  probe.wait(1.0);
  probe.go_to(-10.0, 10.0);
  EXPECT_EQ(probe.model.state().phase, Phase::kPenetration);
  EXPECT_EQ(probe.model.state().ruptures, 1);
  EXPECT_LT(probe.model.state().tip_force_N, 0.5 * InsertionParameters{}.cutting_force_N); // the path is cut
}

TEST(BrainModelPhases, AMeasuredDropOfTheForceIsARupture) {
  BrainModelOptions options = in_an_opening();
  options.probe.radius_mm = 1.5; // the indentation is deeper than it is wide
  Guided probe(options);
  probe.go_to(0.0, 10.0);
  const auto measure = [&](double force_N) {
    ProbeObservation touch = probe.seen();
    touch.force_N = force_N;
    probe.update(touch);
  };
  for (int i = 0; i < 40; ++i) {
    probe.height_mm -= 0.1;
    measure(0.002 * i);
  }
  ASSERT_EQ(probe.model.state().phase, Phase::kIndentation);
  ASSERT_EQ(probe.model.state().ruptures, 0);
  for (int i = 0; i < 10; ++i) {
    measure(0.01);
    EXPECT_NE(probe.model.state().reason, ModelReason::kProbeLeftMesh); // the tissue does not constrain the shaft yet
  }
  EXPECT_EQ(probe.model.state().phase, Phase::kPenetration);
  EXPECT_EQ(probe.model.state().ruptures, 1);
}

TEST(BrainModelPhases, AMeasuredForceCorrectsStiffnessAndForces) {
  Guided probe;
  probe.go_to(0.0, 10.0);
  for (int i = 0; i < 60; ++i) {
    ProbeObservation touch = probe.seen();
    probe.height_mm -= 0.05;
    touch.force_N = 0.5 * probe.model.state().tip_force_N / probe.model.state().stiffness_scale; // half as stiff
    probe.update(touch);
  }
  EXPECT_NEAR(probe.model.state().stiffness_scale, 0.5, 0.05);
}

} // namespace
} // namespace bregma::tissue
