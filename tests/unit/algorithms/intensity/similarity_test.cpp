// Similarity of images, and warps.
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/intensity/similarity.hpp"
#include "algorithms/intensity/warp.hpp"
#include "algorithms/parallel/team.hpp"

namespace {

using namespace bregma::intensity;
constexpr unsigned kIntensitySeed = 20260312;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

TEST(Similarity, RootMeanSquareOfDifferences) {
  const std::vector<float> a = {0, 10, 20, kNaN};
  const std::vector<float> b = {3, 10, 16, 5};
  EXPECT_NEAR(rmse(a, b), std::sqrt(25.0 / 3.0), 1e-12);
  EXPECT_TRUE(std::isnan(rmse(a, std::span(b).first(2))));
  EXPECT_TRUE(std::isnan(rmse({}, {})));
}

TEST(Similarity, MutualInformationOfKnownTables) {
  // Two equal fair coins, and two independent ones: ln 2 and 0.
  const std::vector<float> a = {0, 0, 1, 1};
  const std::vector<float> strange = {0, 1, 0, 1};
  const std::vector<float> inverted = {9, 9, 2, 2};
  EXPECT_NEAR(mutual_information(a, a, 2), std::log(2.0), 1e-12);
  EXPECT_NEAR(mutual_information(a, inverted, 2), std::log(2.0), 1e-12);
  EXPECT_NEAR(mutual_information(a, strange, 2), 0.0, 1e-12);
  const std::vector<float> with_gap = {kNaN, 0, 0, 1, 1};
  const std::vector<float> other = {7, 9, 9, 2, 2};
  EXPECT_NEAR(mutual_information(with_gap, other, 2), std::log(2.0), 1e-12);
  EXPECT_TRUE(std::isnan(mutual_information(a, other)));
  // More pixels than a float counts one by one.
  std::vector<float> half(std::size_t{36} << 20U, 0.0F);
  std::fill(half.begin() + static_cast<std::ptrdiff_t>(half.size() / 2), half.end(), 1.0F);
  EXPECT_NEAR(mutual_information(half, half, 2), std::log(2.0), 1e-9);
  EXPECT_EQ(mutual_information(std::vector<float>(5, 1.0F), std::vector<float>(5, 2.0F)), 0.0);
}

TEST(Similarity, FiguresOfSeveralWarpsAreOverTheirCommonOverlap) {
  const std::vector<float> reference = {0, 10, 20, 30};
  std::vector<float> first = {3, 10, 16, kNaN};
  std::vector<float> second = {kNaN, 10, 20, 31};
  EXPECT_NEAR(rmse(reference, second), std::sqrt(1.0 / 3.0), 1e-6) << "over its own pixels";
  restrict_to_overlap({&first, &second});
  for (const auto *image : {&first, &second}) {
    EXPECT_TRUE(std::isnan(image->front()));
    EXPECT_TRUE(std::isnan(image->back()));
  }
  EXPECT_NEAR(rmse(reference, first), std::sqrt(8.0), 1e-6);
  EXPECT_EQ(rmse(reference, second), 0.0);
  std::vector<float> shorter = {1};
  EXPECT_THROW(restrict_to_overlap({&first, &shorter}), std::invalid_argument);
}

TEST(Warp, LinearImagesAreMovedExactly) {
  // The intensity is a linear function of the position in mm, so linear interpolation has no error.
  bregma::image::Grid<3> grid;
  grid.size = {12, 9, 7};
  grid.T_image_index.topLeftCorner<3, 3>() =
      Eigen::Vector3d(2.0, -1.5, 3.0).asDiagonal(); // the second axis runs backwards
  grid.T_image_index.topRightCorner<3, 1>() = Eigen::Vector3d(-10.0, 6.0, -9.0);
  const auto intensity = [](const Eigen::Vector3d &p) { return 2.0 * p.x() - p.y() + 0.5 * p.z() + 40.0; };
  std::vector<float> image(grid.pixels());
  for (std::size_t i = 0; i < image.size(); ++i) {
    image[i] = static_cast<float>(intensity(grid.pixel_mm(i)));
  }
  const auto same = warp<3>(grid, grid, image, [](const Eigen::Vector3d &p) { return p; });
  EXPECT_LT(rmse(same, image), 1e-4);
  const Eigen::Vector3d shift(1.3, -0.4, 2.2);
  for (const int threads : {1, 2}) {
    bregma::parallel::Team team(threads);
    const auto moved = warp<3>(
        grid, grid, image, [&](const Eigen::Vector3d &p) { return p + shift; }, team);
    int inside = 0;
    for (std::size_t i = 0; i < moved.size(); ++i) {
      if (std::isfinite(moved[i])) {
        ++inside;
        EXPECT_NEAR(moved[i], intensity(grid.pixel_mm(i) + shift), 1e-3);
      }
    }
    EXPECT_EQ(inside, 11 * 8 * 6); // one layer per side comes from outside
  }
}

TEST(Warp, OfAPictureInThePlane) {
  bregma::image::Grid<2> grid;
  grid.size = {40, 30};
  std::mt19937 rng(kIntensitySeed);
  std::vector<float> image(grid.pixels());
  for (float &v : image) {
    v = static_cast<float>(rng() % 256);
  }
  // A quarter turn about the centre of the first 30 x 30 pixels, and its inverse.
  const auto turn = [](const Eigen::Vector2d &p) { return Eigen::Vector2d(29.0 - p.y(), p.x()); };
  const auto back = [](const Eigen::Vector2d &p) { return Eigen::Vector2d(p.y(), 29.0 - p.x()); };
  const auto there = warp<2>(grid, grid, image, turn);
  const auto again = warp<2>(grid, grid, there, back);
  for (std::size_t i = 0; i < again.size(); ++i) {
    if (i % 40 < 30) {
      EXPECT_NEAR(again[i], image[i], 1e-3) << i;
    }
  }
}

} // namespace
