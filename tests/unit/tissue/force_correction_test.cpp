// Correction of the model by measured forces.
#include "algorithms/tissue/contact/force_correction.hpp"

#include <random>

#include <gtest/gtest.h>

namespace bregma::tissue {
namespace {

constexpr double kStep_s = 0.02;

TEST(ForceCorrection, FindsTheTrueStiffnessThroughNoise) {
  std::mt19937 random(5);
  std::normal_distribution<double> noise_N(0.0, 0.005);
  for (const double truth : {0.3, 1.0, 2.5}) {
    ForceCorrection correction;
    correction.touch();
    for (int i = 0; i < 200; ++i) {
      const double modelled_N = 0.001 * i; // during insertion
      correction.indent(modelled_N, truth * modelled_N + noise_N(random), kStep_s);
    }
    EXPECT_NEAR(correction.scale(), truth, 0.05 * truth);
  }
}

TEST(ForceCorrection, OldSamplesLoseTheirWeight) {
  ForceCorrection correction;
  for (int i = 0; i < 200; ++i) {
    correction.indent(0.1, 0.1, kStep_s);
  }
  EXPECT_NEAR(correction.scale(), 1.0, 1e-9);
  for (int i = 0; i < 500; ++i) { // ten seconds over softer tissue
    correction.indent(0.1, 0.05, kStep_s);
  }
  EXPECT_NEAR(correction.scale(), 0.5, 0.01);
}

TEST(ForceCorrection, IgnoresForcesBelowTheSensorsNoise) {
  ForceCorrection correction;
  for (int i = 0; i < 100; ++i) {
    correction.indent(0.005, 0.05, kStep_s);
  }
  EXPECT_EQ(correction.scale(), 1.0);
}

TEST(ForceCorrection, StaysWithinTenfoldEitherWay) {
  ForceCorrection stiff, soft, pulled;
  for (int i = 0; i < 100; ++i) {
    stiff.indent(0.02, 5.0, kStep_s);
    soft.indent(1.0, 0.05, kStep_s);
    pulled.indent(0.1, -1.0, kStep_s);
  }
  EXPECT_EQ(stiff.scale(), 10.0);
  EXPECT_EQ(soft.scale(), 0.1);
  EXPECT_EQ(pulled.scale(), 1.0); // tissue does not pull the tip in, so the scale does not change
}

TEST(ForceCorrection, DetectsALastingDropAndNotOneWrongSample) {
  ForceCorrection correction;
  correction.touch();
  for (int i = 1; i <= 50; ++i) {
    correction.indent(0.002 * i, 0.002 * i, kStep_s);
    EXPECT_FALSE(correction.dropped()) << i;
  }
  correction.indent(0.1, 0.08, kStep_s); // within the variation of a hand
  EXPECT_FALSE(correction.dropped());
  correction.indent(0.1, 0.04, kStep_s);
  EXPECT_FALSE(correction.dropped()); // one sample
  for (int i = 0; i < 10; ++i) {
    correction.indent(0.1, 0.04, kStep_s);
  }
  EXPECT_TRUE(correction.dropped());
  correction.touch(); // the next touch starts from the default
  EXPECT_FALSE(correction.dropped());
}

TEST(ForceCorrection, ADropWithinTheNoiseIsNotARupture) {
  ForceCorrection correction;
  for (int i = 0; i < 10; ++i) {
    correction.indent(0.02, 0.025, kStep_s);
  }
  for (int i = 0; i < 10; ++i) {
    correction.indent(0.02, 0.0, kStep_s);
  }
  EXPECT_FALSE(correction.dropped());
}

TEST(ForceCorrection, TheCuttingForceCorrectsTheModel) {
  ForceCorrection correction;
  const double truth_N = 0.15;
  for (int i = 0; i < 200; ++i) {
    const double modelled_N = 0.06 + correction.extra_cutting_N();
    correction.cut(modelled_N, truth_N, kStep_s);
  }
  EXPECT_NEAR(correction.extra_cutting_N(), 0.09, 1e-3);
  correction.reset();
  EXPECT_EQ(correction.extra_cutting_N(), 0.0);
  EXPECT_EQ(correction.scale(), 1.0);
}

} // namespace
} // namespace bregma::tissue
