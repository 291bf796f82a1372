// Separate markers in images: drawn balls with known centres, among what is no marker.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/mri/grid/marker_points.hpp"

namespace {

using namespace bregma;
using Eigen::Vector3d;
using Volume = image::Image<float, 3>;

// Voxels of the real phantom's scan, with noise and balls of 8 mm.
Volume drawn_balls(const std::vector<Vector3d> &balls, const Vector3d &spacing = {2.6, 2.6, 4.0}, int slices = 20) {
  Volume out;
  out.size = {64, 64, slices};
  out.T_image_index.diagonal().head<3>() = spacing;
  out.T_image_index.topRightCorner<3, 1>() = Vector3d(-80, -80, -38);
  out.voxels.resize(out.pixels());
  std::mt19937 random(3);
  std::normal_distribution<double> noise(20.0, 4.0);
  for (std::size_t i = 0; i < out.voxels.size(); ++i) {
    const Vector3d at = out.pixel_mm(i);
    double signal = noise(random);
    for (const Vector3d &ball : balls) { // partial volume as a ramp over a voxel
      signal += 300.0 * std::clamp((4.0 - (at - ball).norm()) / 3.0 + 0.5, 0.0, 1.0);
    }
    out.voxels[i] = static_cast<float>(signal);
  }
  return out;
}

std::vector<Vector3d> some_balls() {
  std::vector<Vector3d> out;
  for (int k = 0; k < 2; ++k) {
    for (int j = -2; j <= 2; ++j) {
      for (int i = -2; i <= 2; ++i) {
        out.emplace_back(22.0 * i + 0.3 * j + 1.1, 21.0 * j + 0.7 * k - 0.4, 24.0 * k - 14.7 + 0.3 * i);
      }
    }
  }
  return out;
}

double distance_from(const geometry::Points3 &points, const Vector3d &p) {
  return points.cols() == 0 ? 1e9 : (points.colwise() - p).colwise().norm().minCoeff();
}

TEST(MarkerPoints, EachBallIsFoundWithinAFractionOfAVoxel) {
  const auto balls = some_balls();
  const auto found = mri::find_marker_points(drawn_balls(balls));
  ASSERT_TRUE(found.has_value()) << found.error();
  ASSERT_EQ(found->points_mm.cols(), static_cast<Eigen::Index>(balls.size()));
  EXPECT_EQ(found->not_separate_mm.cols(), 0);
  for (const Vector3d &ball : balls) {
    EXPECT_LT(distance_from(found->points_mm, ball), 0.4) << ball.transpose();
  }
}

TEST(MarkerPoints, PlatesAreNoMarkersAndABallAtTheBorderHasNoCentre) {
  auto balls = some_balls();
  balls.emplace_back(60.0, 60.0, -40.0); // its centre lies outside
  Volume image = drawn_balls(balls);
  for (std::size_t i = 0; i < image.voxels.size(); ++i) {
    const Vector3d at = image.pixel_mm(i);
    if (std::abs(at.y() + 70.0) < 4.0) { // a couch
      image.voxels[i] += 300.0F;
    }
  }
  const auto found = mri::find_marker_points(image);
  ASSERT_TRUE(found.has_value()) << found.error();
  EXPECT_EQ(found->points_mm.cols(), static_cast<Eigen::Index>(some_balls().size()));
  EXPECT_GT(found->not_separate_mm.cols(), 0);
  EXPECT_LT(distance_from(found->cut_off_mm, {60.0, 60.0, -38.0}), 5.0);
}

TEST(MarkerPoints, MarkersNearerThanTheStatedDiameterAreListed) {
  std::vector<Vector3d> balls;
  for (int row = 0; row < 5; ++row) { // one plane
    for (int column = 0; column < 5; ++column) {
      balls.emplace_back(19.0 * column - 38.0, 19.0 * row - 37.0, 0.6);
    }
  }
  const Volume image = drawn_balls(balls);
  EXPECT_EQ(mri::find_marker_points(image)->crowded_mm.cols(), 0);
  mri::MarkerOptions wide;
  wide.marker_mm = 20.0;
  wide.min_points = 1;
  const auto found = mri::find_marker_points(image, wide);
  ASSERT_TRUE(found.has_value()) << found.error();
  EXPECT_GT(found->crowded_mm.cols(), 0);
}

TEST(MarkerPoints, NoiseAndUnfitImagesAreRefusedByReason) {
  const auto reason = [](const Volume &image, const mri::MarkerOptions &options = {}) {
    const auto found = mri::find_marker_points(image, options);
    return found ? std::string("found") : found.error();
  };
  EXPECT_NE(reason(drawn_balls({})).find("0 separate markers of 10 mm are seen"), std::string::npos);
  // Wide markers: the smoothing leaves little noise within the image, and more at its border.
  mri::MarkerOptions wide;
  wide.marker_mm = 22.0;
  EXPECT_NE(reason(drawn_balls({}, {1.3, 1.3, 1.3}, 64), wide).find("0 separate markers of 22 mm"), std::string::npos);
  Volume broken = drawn_balls(some_balls());
  broken.voxels[7] = std::nanf("");
  EXPECT_NE(reason(broken).find("not finite"), std::string::npos);
  EXPECT_NE(reason(drawn_balls({}), {-1.0, 8.0, 12}).find("out of range"), std::string::npos);
}

} // namespace
