// Properties of every measure: what holds for all of them runs over all of them, and what holds for some over those.
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "algorithms/intensity/similarity_measure.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"

namespace bregma::intensity {
namespace {

using Eigen::Matrix4d;
using test::pose;

const Matrix4d kSame = Matrix4d::Identity();

double compare(Measure measure, const Volume &reference, const Volume &floating, const MeasureOptions &options = {},
               const Matrix4d &T = kSame, int threads = 1) {
  parallel::Team team(threads);
  return make_measure(measure, reference, floating, options, team)->value(T);
}

MeasureOptions binned(int bins, Interpolation interpolation = Interpolation::kNearest) {
  MeasureOptions out;
  out.bins = bins;
  out.interpolation = interpolation;
  return out;
}

// A second modality: not a function of the first, but related to it.
Volume other_modality(const Volume &image) {
  Volume out = image;
  for (std::size_t i = 0; i < out.voxels.size(); ++i) {
    const auto grey = static_cast<double>(out.voxels[i]);
    out.voxels[i] = static_cast<float>(80.0 * std::sin(grey / 40.0) + 4.0 * std::cos(0.3 * image.pixel_mm(i).x()));
  }
  return out;
}

class EveryMeasure : public testing::TestWithParam<MeasureName> {};

TEST_P(EveryMeasure, IsLargestWhereIdenticalImagesCoincide) {
  const Measure measure = GetParam().measure;
  for (const bool in_space : {false, true}) {
    const Volume image = in_space ? test::head_phantom() : test::plane_phantom();
    parallel::Team team(2);
    MeasureOptions options;
    options.bins = 32;
    if (measure == Measure::kMi || measure == Measure::kLleHe) {
      // Without normalisation, information per sample grows where dark background leaves the overlap.
      options.outside = Outside::kDark;
    }
    const auto made = make_measure(measure, image, image, options, team);
    const double best = made->value(kSame);
    ASSERT_TRUE(std::isfinite(best));
    EXPECT_GT(made->overlap(), 0.999);
    for (const Matrix4d &T : {pose({0, 0, 3}, {0, 0, 0}), pose({0, 0, -8}, {0, 0, 0}), pose({0, 0, 0}, {2.5, 0, 0}),
                              pose({0, 0, 0}, {0, -3, 0}), pose({0, 0, 25}, {4, 0, 0})}) {
      EXPECT_LT(made->value(T), best) << T;
    }
    if (in_space) {
      EXPECT_LT(made->value(pose({6, 0, 0}, {0, 0, 0})), best);
      EXPECT_LT(made->value(pose({0, 0, 0}, {0, 0, 3})), best);
    }
  }
}

TEST_P(EveryMeasure, DoesNotDependOnTheNumberOfThreads) {
  const Volume reference = test::phantom({40, 44, 36}, {1.6, 1.6, 1.6}); // several parts
  const Volume floating = other_modality(reference);
  const Matrix4d T = pose({2, -3, 4}, {1.5, -1, 2});
  const double alone = compare(GetParam().measure, reference, floating, {}, T, 1);
  EXPECT_EQ(compare(GetParam().measure, reference, floating, {}, T, 2), alone);
  EXPECT_EQ(compare(GetParam().measure, reference, floating, {}, T, 3), alone);
}

TEST_P(EveryMeasure, AllocatesNothingInAnEvaluation) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "a sanitizer has replaced malloc";
  }
  const Volume image = test::head_phantom();
  parallel::Team team(1);
  const auto made = make_measure(GetParam().measure, image, other_modality(image), {}, team);
  AffineGradient gradient;
  const test::AllocationScope scope;
  double sum = made->value(pose({1, 2, 3}, {1, 0, 0}));
  sum += made->value_and_gradient(pose({0, 2, 3}, {1, 2, 0}), gradient);
  EXPECT_EQ(scope.count(), 0U);
  EXPECT_TRUE(std::isfinite(sum));
}

TEST_P(EveryMeasure, IsUnknownWithoutOverlap) {
  const Volume image = test::head_phantom();
  parallel::Team team(1);
  const auto made = make_measure(GetParam().measure, image, image, {}, team);
  EXPECT_TRUE(std::isnan(made->value(pose({0, 0, 0}, {500, 0, 0}))));
  EXPECT_EQ(made->overlap(), 0.0);
  EXPECT_TRUE(std::isfinite(made->value(pose({0, 0, 0}, {34, 0, 0}))));
  EXPECT_NEAR(made->overlap(), 0.5, 0.06);
  // Mapped beyond the floating image, dark grey values are compared instead.
  MeasureOptions dark;
  dark.outside = Outside::kDark;
  const auto filled = make_measure(GetParam().measure, image, image, dark, team);
  EXPECT_TRUE(std::isfinite(filled->value(pose({0, 0, 0}, {40, 0, 0}))));
  EXPECT_GT(filled->overlap(), 0.99);
}

TEST_P(EveryMeasure, ConstantImagesShareNoInformation) {
  const Volume image = test::head_phantom();
  Volume flat = image;
  std::fill(flat.voxels.begin(), flat.voxels.end(), 7.0F);
  const double value = compare(GetParam().measure, image, flat);
  const std::string_view name = GetParam().name;
  const bool normalised = name == "nmi" || name == "gmi" || name == "ami" || name == "mf-mi";
  EXPECT_NEAR(value, normalised ? 1.0 : 0.0, 1e-6);
}

TEST_P(EveryMeasure, LeavesMaskedVoxelsOut) {
  const Volume image = test::head_phantom();
  const Volume other = other_modality(image);
  Volume masked = image;
  Volume spoiled = image;
  for (int j = 0; j < image.size[1]; ++j) {
    for (int i = 0; i < image.size[0]; ++i) {
      for (int k = 0; k < 6; ++k) { // a slab that is not the body's
        masked.voxels[image.offset(i, j, k)] = std::numeric_limits<float>::quiet_NaN();
        spoiled.voxels[image.offset(i, j, k)] = static_cast<float>((i * 7 + j * 13) % 90);
      }
    }
  }
  const double clean = compare(GetParam().measure, masked, other, binned(32));
  EXPECT_TRUE(std::isfinite(clean));
  EXPECT_NE(clean, compare(GetParam().measure, spoiled, other, binned(32)));
  // The mask of the floating image does the same, up to neighbours of the slab.
  EXPECT_TRUE(std::isfinite(compare(GetParam().measure, other, masked, binned(32))));
  parallel::Team team(2);
  const auto measure = make_measure(GetParam().measure, other, masked, {}, team);
  if (measure->has_gradient()) {
    AffineGradient gradient;
    EXPECT_TRUE(std::isfinite(measure->value_and_gradient(Matrix4d::Identity(), gradient)));
    EXPECT_TRUE(gradient.allFinite());
  }
}

INSTANTIATE_TEST_SUITE_P(Measures, EveryMeasure, testing::ValuesIn(kMeasures), [](const auto &made) {
  std::string name(made.param.name);
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

TEST(SimilarityMeasures, AreSymmetricExceptWhereOneImageHasAnotherRole) {
  const Volume a = test::head_phantom();
  const Volume b = other_modality(a);
  for (const MeasureName &m : kMeasures) {
    if (m.measure == Measure::kLleHe) {
      continue; // only the reference has the ordinal feature
    }
    const double there = compare(m.measure, a, b, binned(32));
    EXPECT_NEAR(compare(m.measure, b, a, binned(32)), there, 1e-5 * std::abs(there)) << m.name;
  }
}

TEST(SimilarityMeasures, DoNotDependOnMonotoneMapsWhereTheyCountBinsOnly) {
  const Volume a = test::quantised(test::head_phantom(), 8);
  const Volume b = test::quantised(other_modality(test::head_phantom()), 8);
  Volume bright = b; // strictly monotone and not linear; each level keeps a bin of its own
  std::transform(b.voxels.begin(), b.voxels.end(), bright.voxels.begin(), [](float v) { return v * (v + 9.0F); });
  Volume inverted = b;
  std::transform(b.voxels.begin(), b.voxels.end(), inverted.voxels.begin(), [](float v) { return 7.0F - v; });
  const MeasureOptions options = binned(256);
  for (const Measure measure :
       {Measure::kMi, Measure::kNmi, Measure::kCmi, Measure::kSemi, Measure::kSecondOrderMi, Measure::kLleHe}) {
    const double value = compare(measure, a, b, options);
    EXPECT_NEAR(compare(measure, a, bright, options), value, 1e-6 * std::abs(value)) << name_of(measure);
  }
  for (const MeasureName &m : kMeasures) {
    if (m.measure == Measure::kAmi || m.measure == Measure::kMfMi) {
      continue; // grey value plus gradient, and distance times grey value, change with the direction of the greys
    }
    const double value = compare(m.measure, a, b, options);
    EXPECT_NEAR(compare(m.measure, a, inverted, options), value, 1e-3 * std::abs(value)) << m.name;
  }
}

// Table 4.1, line by line.
TEST(MutualInformation, HasThePropertiesOfTable41) {
  const Volume x = test::quantised(test::head_phantom(), 12);
  const Volume y = test::quantised(other_modality(test::head_phantom()), 12);
  const MeasureOptions options = binned(64);
  const auto mi = [&](const Volume &a, const Volume &b) { return compare(Measure::kMi, a, b, options); };
  const double information = mi(x, y);
  const double of_x = mi(x, x); // self-information: the entropy
  const double of_y = mi(y, y);
  std::array<double, 12> count{};
  for (const float v : x.voxels) {
    count[static_cast<std::size_t>(v)] += 1.0;
  }
  double entropy = 0.0;
  for (const double c : count) {
    const double p = c / static_cast<double>(x.voxels.size());
    entropy -= p > 0.0 ? p * std::log(p) : 0.0;
  }
  EXPECT_NEAR(of_x, entropy, 1e-9);
  EXPECT_GT(information, 0.0);
  EXPECT_NEAR(mi(y, x), information, 1e-12);
  EXPECT_LE(information, std::min(of_x, of_y));
  EXPECT_LE(information, 0.5 * (of_x + of_y));
  const double joint = of_x + of_y - information; // (25)
  EXPECT_LE(0.5 * (of_x + of_y), std::max(of_x, of_y));
  EXPECT_LE(std::max(of_x, of_y), joint) << "(26), (27): neither image leaves less than nothing open";
  EXPECT_LE(joint, of_x + of_y);
  // Data processing: a function of Y knows no more about X.
  Volume coarse = y;
  std::transform(y.voxels.begin(), y.voxels.end(), coarse.voxels.begin(), [](float v) { return std::floor(v / 3.0F); });
  EXPECT_LT(mi(x, coarse), information);
}

TEST(MutualInformation, IsZeroForIndependentImagesAndMfMiIsTheSumOfItsWeights) {
  Volume x;
  x.size = {32, 32, 1};
  for (int j = 0; j < 32; ++j) {
    for (int i = 0; i < 32; ++i) {
      x.voxels.push_back(static_cast<float>(i % 8));
    }
  }
  Volume y = x;
  for (int j = 0; j < 32; ++j) {
    for (int i = 0; i < 32; ++i) {
      y.voxels[x.offset(i, j, 0)] = static_cast<float>(j % 8);
    }
  }
  EXPECT_NEAR(compare(Measure::kMi, x, y, binned(8)), 0.0, 1e-9);
  EXPECT_NEAR(compare(Measure::kNmi, x, y, binned(8)), 1.0, 1e-9);
  MeasureOptions options = binned(8);
  options.features = {Feature::kGrey, Feature::kGradient};
  options.weights = {0.3, 0.5};
  EXPECT_NEAR(compare(Measure::kMfMi, x, y, options), 0.8, 1e-9);
}

TEST(MfMi, WithOneFeatureIsNmi) {
  const Volume a = test::head_phantom();
  const Volume b = other_modality(a);
  MeasureOptions options;
  options.features = {Feature::kGrey};
  EXPECT_EQ(compare(Measure::kMfMi, a, b, options), compare(Measure::kNmi, a, b));
}

TEST(MfMi, WeightsAreRankedByEntropyAndSumToOne) {
  EXPECT_EQ(rank_weights({2.0}), (std::vector<double>{1.0}));
  EXPECT_EQ(rank_weights({3.0, 1.0}), (std::vector<double>{2.0 / 3.0, 1.0 / 3.0}));
  EXPECT_EQ(rank_weights({1.0, 4.0, 2.0}), (std::vector<double>{1.0 / 6.0, 3.0 / 6.0, 2.0 / 6.0}));
}

TEST(JointHistogram, EveryInterpolationAgreesWhereVoxelsCoincide) {
  const Volume a = test::head_phantom();
  const Volume b = other_modality(a);
  const double nearest = compare(Measure::kMi, a, b, binned(48));
  EXPECT_NEAR(compare(Measure::kMi, a, b, binned(48, Interpolation::kLinear)), nearest, 1e-9);
  EXPECT_NEAR(compare(Measure::kMi, a, b, binned(48, Interpolation::kPartialVolume)), nearest, 1e-6);
  // The B-spline spreads a sample over four bins, so it loses information.
  const double parzen = compare(Measure::kMi, a, b, binned(48, Interpolation::kParzen));
  EXPECT_LT(parzen, nearest);
  EXPECT_GT(parzen, 0.7 * nearest);
}

TEST(JointHistogram, PartialVolumeChangesGraduallyBetweenVoxels) {
  const Volume a = test::head_phantom();
  parallel::Team team(1);
  const auto measure = make_measure(Measure::kMi, a, a, binned(32, Interpolation::kPartialVolume), team);
  double before = measure->value(kSame);
  for (int step = 1; step <= 10; ++step) {
    const double now = measure->value(pose({0, 0, 0}, {0.1 * step, 0, 0}));
    EXPECT_LT(std::abs(now - before), 0.25);
    EXPECT_LT(now, before);
    before = now;
  }
}

TEST(SimilarityMeasures, GradientIsThatOfDifferences) {
  // The floating image is larger, so that no sample leaves the overlap.
  const Volume reference = test::phantom({20, 22, 18}, {2.0, 2.0, 2.0});
  const Volume floating = other_modality(test::phantom({44, 40, 42}, {1.9, 2.1, 2.0}));
  parallel::Team team(2);
  const Matrix4d T = pose({4, -6, 5}, {2, 1.5, -1});
  for (const Measure m : {Measure::kMi, Measure::kNmi, Measure::kGmi, Measure::kAmi, Measure::kMfMi}) {
    for (const std::size_t max_samples : {std::size_t{0}, std::size_t{3000}}) {
      MeasureOptions options;
      options.bins = 32;
      options.max_samples = max_samples;
      const auto measure = make_measure(m, reference, floating, options, team);
      ASSERT_TRUE(measure->has_gradient());
      AffineGradient gradient;
      EXPECT_EQ(measure->value_and_gradient(T, gradient), measure->value(T));
      EXPECT_NEAR(measure->overlap(), 1.0, 1e-6);
      const double largest = gradient.cwiseAbs().maxCoeff();
      for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 4; ++column) {
          const double step = column < 3 ? 1e-3 : 2e-2; // moves samples by up to 0.02 mm
          Matrix4d up = T;
          Matrix4d down = T;
          up(row, column) += step;
          down(row, column) -= step;
          const double difference = (measure->value(up) - measure->value(down)) / (2.0 * step);
          EXPECT_NEAR(gradient(row, column), difference, 0.05 * largest) << name_of(m) << " " << row << " " << column;
        }
      }
    }
  }
}

TEST(SimilarityMeasures, ASampleOfTheVoxelsGivesAboutTheSameValue) {
  const Volume a = test::phantom({48, 52, 44}, {1.3, 1.3, 1.3});
  const Volume b = other_modality(a);
  MeasureOptions options;
  options.bins = 32;
  const Matrix4d T = pose({3, 0, 2}, {1, 1, 0});
  const double all = compare(Measure::kNmi, a, b, options, T);
  options.max_samples = 20000;
  EXPECT_NEAR(compare(Measure::kNmi, a, b, options, T), all, 0.02 * all);
  const double first = compare(Measure::kNmi, a, b, options, T);
  EXPECT_EQ(compare(Measure::kNmi, a, b, options, T), first) << "the same seed, the same samples";
}

TEST(SimilarityMeasures, RefuseOptionsThatMakeNoSense) {
  const Volume image = test::plane_phantom();
  const auto message = [&](Measure measure, const MeasureOptions &options) -> std::string {
    parallel::Team team(1);
    try {
      (void)make_measure(measure, image, image, options, team);
    } catch (const std::invalid_argument &error) {
      return error.what();
    }
    return {};
  };
  EXPECT_EQ(message(Measure::kMi, binned(4)), "bins: 4 is not from 8 to 256");
  EXPECT_EQ(message(Measure::kRmi, binned(64, Interpolation::kPartialVolume)),
            "partial volume interpolation: rmi needs interpolated values");
  MeasureOptions none;
  none.features.clear();
  EXPECT_EQ(message(Measure::kMfMi, none), "features: mf-mi needs at least one");
  MeasureOptions odd;
  odd.weights = {1.0};
  EXPECT_EQ(message(Measure::kMfMi, odd), "weights: 1 for 2 features");
}

} // namespace
} // namespace bregma::intensity
