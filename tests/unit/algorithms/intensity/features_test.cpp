// Features of an image against values that are known in closed form.
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "algorithms/intensity/features.hpp"
#include "algorithms/intensity/resolution.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"

namespace bregma::intensity {
namespace {

constexpr unsigned kFeatureSeed = 20260401;

Volume noise(std::array<int, 3> size, float sigma) {
  Volume out;
  out.size = size;
  std::mt19937 rng(kFeatureSeed);
  std::normal_distribution<float> normal(100.0F, sigma);
  out.voxels.resize(out.pixels());
  std::generate(out.voxels.begin(), out.voxels.end(), [&] { return normal(rng); });
  return out;
}

TEST(Features, GradientOfALinearImageIsItsSlopeInTheFrameOnAnObliqueGrid) {
  Volume image;
  image.size = {7, 6, 5};
  image.T_image_index.topLeftCorner<3, 3>() =
      Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix() *
      Eigen::Vector3d(1.0, 2.0, 3.0).asDiagonal();
  const Eigen::Vector3d slope(3.0, -1.0, 0.5); // per mm
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    image.voxels.push_back(static_cast<float>(slope.dot(image.pixel_mm(i))));
  }
  parallel::Team team(2);
  const Gradient g = gradient(image, team);
  const std::vector<float> magnitude = gradient_magnitude(image, team);
  constexpr double kMeanSpacing = 2.0;
  for (std::size_t i = 0; i < image.voxels.size(); ++i) {
    EXPECT_NEAR(g.x[i], kMeanSpacing * slope.x(), 1e-3);
    EXPECT_NEAR(g.y[i], kMeanSpacing * slope.y(), 1e-3);
    EXPECT_NEAR(g.z[i], kMeanSpacing * slope.z(), 1e-3);
    EXPECT_NEAR(magnitude[i], kMeanSpacing * slope.norm(), 1e-3);
  }
}

TEST(Features, SignificanceIsAtMostOneAndLargerAtEdges) {
  Volume image = test::plane_phantom();
  parallel::Team team(1);
  const std::vector<float> S = significance(image, team);
  const GreyRange range = grey_range(S);
  EXPECT_GE(range.low, 0.0F);
  EXPECT_LE(range.high, 1.0F);
  const std::vector<float> G = gradient_magnitude(image, team);
  const GreyRange grey = grey_range(image.voxels);
  const float scale = grey_range(G).high + grey.high - grey.low;
  EXPECT_NEAR(S[1234], (G[1234] + image.voxels[1234] - grey.low) / scale, 1e-6F);
}

TEST(Features, AigAsPrintedIsZeroEverywhereAndItsReadingsAreNot) {
  parallel::Team team(1);
  const Volume head = test::plane_phantom();
  for (const Volume &image : {test::quantised(head, 6), noise({40, 40, 1}, 10.0F)}) {
    const std::vector<float> printed = adaptive_image_gradient(image, AigReading::kPrinted, team);
    EXPECT_TRUE(std::all_of(printed.begin(), printed.end(), [](float v) { return v == 0.0F; }));
  }
  for (const AigReading reading :
       {AigReading::kDistance, AigReading::kDistanceTimesSlope, AigReading::kDistanceTimesGrey}) {
    EXPECT_GT(grey_range(adaptive_image_gradient(head, reading, team)).high, 0.0F);
  }
}

TEST(Features, DistanceIsThatToTheNearestVoxelOfTheSet) {
  Volume grid;
  grid.size = {11, 9, 7};
  grid.T_image_index.topLeftCorner<3, 3>() = Eigen::Vector3d(1.0, 1.5, 2.0).asDiagonal();
  std::vector<char> set(grid.pixels());
  std::mt19937 rng(kFeatureSeed);
  for (int n = 0; n < 9; ++n) {
    set[rng() % set.size()] = 1;
  }
  const std::vector<float> distance = distance_to(grid, set);
  constexpr double kMeanSpacing = 1.5;
  for (std::size_t i = 0; i < set.size(); ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < set.size(); ++k) {
      if (set[k] != 0) {
        nearest = std::min(nearest, (grid.pixel_mm(i) - grid.pixel_mm(k)).norm());
      }
    }
    EXPECT_NEAR(distance[i], nearest / kMeanSpacing, 1e-4);
  }
  const std::vector<float> of_none = distance_to(grid, std::vector<char>(set.size()));
  EXPECT_EQ(grey_range(of_none).high, 0.0F);
}

TEST(Features, StandardDeviationOfNoiseIsItsSigma) {
  parallel::Team team(2);
  const std::vector<float> deviation = standard_deviation(noise({30, 30, 30}, 4.0F), 2, team);
  double sum = 0.0;
  for (const float v : deviation) {
    sum += static_cast<double>(v);
  }
  EXPECT_NEAR(sum / static_cast<double>(deviation.size()), 4.0, 0.1);
}

TEST(Features, CornersOfASquareAreAtItsCorners) {
  Volume image;
  image.size = {40, 40, 1};
  image.voxels.assign(image.pixels(), 0.0F);
  for (int j = 12; j < 28; ++j) {
    for (int i = 12; i < 28; ++i) {
      image.voxels[image.offset(i, j, 0)] = 100.0F;
    }
  }
  parallel::Team team(1);
  const std::vector<float> corner = corners(image, team);
  const float at_edge = corner[image.offset(12, 20, 0)];
  for (const auto &[i, j] : {std::pair(12, 12), std::pair(27, 12), std::pair(12, 27), std::pair(27, 27)}) {
    EXPECT_GT(corner[image.offset(i, j, 0)], 5.0F * at_edge + 1.0F);
  }
}

TEST(Features, ShrinkingKeepsPlacesAndMissingVoxels) {
  Volume image;
  image.size = {24, 30, 18};
  image.T_image_index.topLeftCorner<3, 3>() = Eigen::Vector3d(1.0, 1.0, 2.0).asDiagonal();
  image.T_image_index.topRightCorner<3, 1>() = Eigen::Vector3d(-5.0, 3.0, 8.0);
  const Eigen::Vector3d slope(1.0, -2.0, 0.5);
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    image.voxels.push_back(static_cast<float>(slope.dot(image.pixel_mm(i))));
  }
  image.voxels[image.offset(0, 0, 0)] = std::numeric_limits<float>::quiet_NaN();
  parallel::Team team(2);
  const Volume small = shrunk(image, 2.0, team);
  EXPECT_EQ(small.size, (std::array<int, 3>{12, 15, 18})) << "the third axis has that spacing already";
  EXPECT_TRUE(std::isnan(small.voxels[0]));
  for (const auto &index : {std::array{5, 7, 8}, std::array{6, 5, 10}}) {
    const std::size_t at = small.offset(index[0], index[1], index[2]);
    EXPECT_NEAR(small.voxels[at], slope.dot(small.pixel_mm(at)), 0.02);
  }
}

TEST(Features, RangeWithoutItsTailsIsThatOfTheOrderedValues) {
  std::vector<float> values = noise({40, 30, 1}, 7.0F).voxels;
  values[17] = 1e6F; // metal
  values[400] = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> ordered = values;
  ordered.erase(ordered.begin() + 400);
  std::sort(ordered.begin(), ordered.end());
  for (const std::size_t cut : {std::size_t{1}, std::size_t{60}, std::size_t{599}}) {
    const double tail = (static_cast<double>(cut) + 0.5) / static_cast<double>(ordered.size() - 1);
    const GreyRange range = grey_range(values, tail);
    EXPECT_EQ(range.low, ordered[cut]);
    EXPECT_EQ(range.high, ordered[ordered.size() - 1 - cut]);
  }
}

TEST(Features, ThresholdSeparatesTwoClasses) {
  std::vector<float> values;
  std::mt19937 rng(kFeatureSeed);
  std::normal_distribution<float> normal(0.0F, 1.0F);
  for (int i = 0; i < 2000; ++i) {
    values.push_back((i % 5 == 0 ? 20.0F : 5.0F) + normal(rng));
  }
  const float threshold = otsu_threshold(values);
  EXPECT_GT(threshold, 7.5F);
  EXPECT_LT(threshold, 17.5F);
  EXPECT_EQ(otsu_threshold(std::vector<float>(10, 3.0F)), 3.0F);
}

} // namespace
} // namespace bregma::intensity
