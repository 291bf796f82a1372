// Crossings of a grid phantom drawn by its geometry alone: distorted, tilted, noisy, with bubbles and broken bars.
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/geometry/rigid3.hpp"
#include "algorithms/mri/grid/grid_points.hpp"
#include "tests/unit/mri/field_phantom.hpp"

namespace {

using namespace bregma;
using namespace bregma::mri;
using Eigen::Vector3d;
using geometry::Points3;

constexpr int kBars = 5; // in each direction
constexpr double kCell = 15.0, kHalfBar = 1.0;
constexpr int kParts = 4; // of a voxel along each axis: its share of plastic

struct Drawing {
  bool bright = false;
  double noise = 0.0;
  std::vector<Vector3d> bubbles; // in the phantom, radius 3 mm
  Vector3d spacing{1.0, 1.0, 1.0};
  test::SourceField field{21, 1.5};
  geometry::Rigid3<geometry::frame::Target, geometry::frame::Source> T{geometry::rotation_exp({0.03, -0.04, 0.05}),
                                                                       Vector3d(3.0, -2.0, 1.0)};
};

double plastic(const Vector3d &p) {
  constexpr double kEnd = 0.5 * (kBars - 1) * kCell;
  int near = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(p[axis]) > kEnd + kHalfBar) {
      return 0.0;
    }
    const double from_bar = p[axis] + kEnd - kCell * std::round((p[axis] + kEnd) / kCell);
    near += std::abs(from_bar) < kHalfBar ? 1 : 0;
  }
  return near >= 2 ? 1.0 : 0.0; // a bar is near two of its planes
}

Points3 crossings(const Drawing &d) {
  const Points3 nodes = test::lattice(kBars, kCell);
  Points3 out(3, nodes.cols());
  for (Eigen::Index i = 0; i < nodes.cols(); ++i) {
    out.col(i) = d.field.image_of(Vector3d(d.T * Vector3d(nodes.col(i))));
  }
  return out;
}

image::Image<float, 3> draw(const Drawing &d) {
  image::Image<float, 3> out;
  const double side = 92.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out.size[axis] = static_cast<int>(side / d.spacing[static_cast<Eigen::Index>(axis)]);
  }
  out.T_image_index.topLeftCorner<3, 3>() = d.spacing.asDiagonal();
  out.T_image_index.topRightCorner<3, 1>() = Vector3d::Constant(-0.5 * side);
  std::mt19937 rng(7);
  std::normal_distribution<double> gauss;
  const auto T_inverse = d.T.inverse();
  out.voxels.reserve(out.pixels());
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    const Vector3d shown = out.pixel_mm(i);
    Vector3d p = shown;
    for (int step = 0; step < 4; ++step) {
      p = shown - d.field.displacement(p);
    }
    double sum = 0.0;
    for (int part = 0; part < kParts * kParts * kParts; ++part) {
      const Eigen::Vector3i place(part % kParts, (part / kParts) % kParts, part / (kParts * kParts));
      const Vector3d offset = (place.cast<double>() + Vector3d::Constant(0.5)) / kParts - Vector3d::Constant(0.5);
      const Vector3d at = T_inverse * Vector3d(p + offset.cwiseProduct(d.spacing));
      const bool empty =
          std::any_of(d.bubbles.begin(), d.bubbles.end(), [&](const Vector3d &b) { return (at - b).norm() < 3.0; });
      sum += d.bright ? plastic(at) : empty ? 0.0 : 1.0 - plastic(at);
    }
    const double share = sum / (kParts * kParts * kParts);
    out.voxels.push_back(static_cast<float>(std::abs(1000.0 * share + d.noise * gauss(rng))));
  }
  return out;
}

struct Score {
  int found = 0, wrong = 0;
  double mean_mm = 0.0, max_mm = 0.0;
};
Score score(const Points3 &points, const Points3 &truth) {
  Score out;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const double d = (truth.colwise() - points.col(i)).colwise().norm().minCoeff();
    if (d > 2.0) {
      ++out.wrong;
      continue;
    }
    ++out.found;
    out.mean_mm += d;
    out.max_mm = std::max(out.max_mm, d);
  }
  out.mean_mm /= std::max(out.found, 1);
  return out;
}

GridOptions options(bool bright) {
  GridOptions out;
  out.bright = bright;
  return out;
}

TEST(GridPoints, CrossingsAreFoundBelowAVoxelInBothContrasts) {
  for (const bool bright : {false, true}) {
    Drawing d;
    d.bright = bright;
    d.noise = 30.0;
    const auto grid = find_grid_points(draw(d), options(bright));
    ASSERT_TRUE(grid) << grid.error();
    const Score s = score(grid->points_mm, crossings(d));
    EXPECT_GE(s.found, 122) << "of 125";
    EXPECT_GT(grid->completed, 10); // corners have no branches
    EXPECT_EQ(s.wrong, 0);
    EXPECT_LT(s.mean_mm, 0.17);
    EXPECT_LT(s.max_mm, 0.6);
    EXPECT_EQ(grid->planes, kBars);
    EXPECT_EQ(grid->bars.size(), static_cast<std::size_t>(grid->points_mm.cols()));
  }
}

// At a face the bars go to one side only, and a slope of the distortion turns them.
TEST(GridPoints, CrossingsAtAFaceFollowTheBarsThatTheDistortionTurns) {
  Drawing d;
  d.field.bump_mm = 4.0;
  const auto grid = find_grid_points(draw(d));
  ASSERT_TRUE(grid) << grid.error();
  const Score s = score(grid->points_mm, crossings(d));
  EXPECT_EQ(s.found, 125);
  EXPECT_EQ(s.wrong, 0);
  EXPECT_LT(s.mean_mm, 0.08);
  EXPECT_LT(s.max_mm, 0.2); // 0.28 if the bars are taken for straight
}

TEST(GridPoints, SlicesMayBeThickAndLieAlongAnyAxis) {
  Drawing d;
  d.noise = 20.0;
  d.spacing = {1.5, 1.0, 1.0};
  const auto grid = find_grid_points(draw(d));
  ASSERT_TRUE(grid) << grid.error();
  const Score s = score(grid->points_mm, crossings(d));
  EXPECT_GE(s.found, 118);
  EXPECT_EQ(s.wrong, 0);
  EXPECT_LT(s.mean_mm, 0.2);
  GridOptions along;
  along.axis = 0;
  const auto first = find_grid_points(draw(d), along);
  ASSERT_TRUE(first) << first.error();
  EXPECT_EQ(first->axis, 0);
  EXPECT_EQ(score(first->points_mm, crossings(d)).wrong, 0);
}

TEST(GridPoints, TheCellIsMeasuredWhereItIsStatedRoughly) {
  const Drawing d;
  const auto image = draw(d);
  for (const double stated : {13.0, 17.5}) {
    GridOptions rough;
    rough.cell_mm = stated;
    const auto grid = find_grid_points(image, rough);
    ASSERT_TRUE(grid) << grid.error();
    EXPECT_NEAR(grid->cell_mm, kCell, 0.3) << stated;
    const Score s = score(grid->points_mm, crossings(d));
    EXPECT_GE(s.found, 122) << stated;
    EXPECT_EQ(s.wrong, 0) << stated;
  }
}

TEST(GridPoints, BubblesMoveNoPointFarAndAddNone) {
  Drawing d;
  d.noise = 20.0;
  d.bubbles = {{7.0, 7.5, 0.0}, {-15.0, 4.0, 15.0}, {2.0, -13.0, -15.0}, {20.0, -20.0, 22.0}};
  const auto grid = find_grid_points(draw(d));
  ASSERT_TRUE(grid) << grid.error();
  const Score s = score(grid->points_mm, crossings(d));
  EXPECT_GE(s.found, 118);
  EXPECT_EQ(s.wrong, 0);
  EXPECT_LT(s.mean_mm, 0.2);
  EXPECT_LT(s.max_mm, 1.2);
}

TEST(GridPoints, ImagesWithoutAGridAreRefusedByReason) {
  image::Image<float, 3> empty;
  empty.size = {60, 60, 60};
  empty.voxels.assign(empty.pixels(), 100.0F);
  const auto message = [](const image::Image<float, 3> &image, const GridOptions &o = {}) {
    const auto grid = find_grid_points(image, o);
    return grid ? std::string("accepted") : grid.error();
  };
  EXPECT_EQ(message(empty), "0 crossings of bars are seen, which are taken as darker than what surrounds them; a grid "
                            "phantom with cells of 15 mm has at least 27");
  std::mt19937 rng(3);
  std::normal_distribution<float> gauss(100.0F, 20.0F);
  std::generate(empty.voxels.begin(), empty.voxels.end(), [&] { return gauss(rng); });
  EXPECT_NE(message(empty).find("crossings of bars are seen"), std::string::npos) << message(empty);
  GridOptions wide;
  wide.cell_mm = 40.0;
  EXPECT_EQ(message(empty, wide), "the image is 60 mm long along axis 1, less than two cells");
  wide.bar_mm = 30.0;
  EXPECT_EQ(message(empty, wide), "a cell of 40 mm with bars of 30 mm is out of range: a cell is wider than two bars");
  wide.bar_mm = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(message(empty, wide).find("bars of nan mm is out of range"), std::string::npos);
  image::Image<float, 3> metres = empty;
  metres.T_image_index.topLeftCorner<3, 3>() *= 1000.0;
  EXPECT_EQ(message(metres), "the voxels are 1000 mm long along axis 1, more than half a cell of 15 mm: in which unit "
                             "is the image?");
  empty.voxels[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(message(empty), "a voxel is missing or not finite");
}

} // namespace
