#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <vector>

#include "algorithms/registration/surface/degenerate_shape.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::registration {
namespace {

using Eigen::Vector3d;

constexpr unsigned kShapeSeed = 20261127;

double rms(const std::vector<double> &values) {
  return std::sqrt(std::inner_product(values.begin(), values.end(), values.begin(), 0.0) /
                   static_cast<double>(values.size()));
}

// Points of a scaled unit sphere above a height, at a random pose, with noise.
std::vector<Vector3d> cloud(std::size_t count, const Vector3d &radii_mm, double above, double sigma_mm,
                            std::mt19937 &rng) {
  const Eigen::Quaterniond turn = Eigen::Quaterniond(0.9, -0.2, 0.35, 0.1).normalized();
  std::vector<Vector3d> out;
  while (out.size() < count) {
    const Vector3d direction = test::normal_vector(rng, 1.0).normalized();
    if (direction.z() > above) {
      out.push_back(turn * Vector3d(direction.cwiseProduct(radii_mm)) + Vector3d(40, -300, 12) +
                    test::normal_vector(rng, sigma_mm));
    }
  }
  return out;
}

TEST(FeaturelessShape, AnExactShapeHasNoDistances) {
  std::mt19937 rng(kShapeSeed);
  std::vector<double> distances(150);
  fit_plane(cloud(150, {60, 40, 0}, -1.0, 0.0, rng), distances);
  EXPECT_LT(rms(distances), 1e-9);
  fit_sphere(cloud(150, {80, 80, 80}, 0.3, 0.0, rng), 1.0, distances);
  EXPECT_LT(rms(distances), 1e-9);
  for (const Vector3d &radii : {Vector3d(78, 78, 95), Vector3d(90, 90, 60), Vector3d(70, 100, 70)}) {
    for (const double above : {-1.0, 0.0}) {
      fit_spheroid(cloud(150, radii, above, 0.0, rng), 1.0, distances);
      EXPECT_LT(rms(distances), 1e-3) << radii.transpose() << ", above " << above;
    }
  }
}

TEST(FeaturelessShape, NoiseIsKeptAndOutliersAreIgnored) {
  std::mt19937 rng(kShapeSeed);
  const std::size_t count = 1000; // more points than the fit uses
  std::vector<Vector3d> points = cloud(count, {78, 78, 95}, -1.0, 1.0, rng);
  std::vector<double> distances(count);
  fit_spheroid(points, 1.0, distances);
  EXPECT_NEAR(rms(distances), 1.0, 0.06);
  for (std::size_t i = 0; i < 30; ++i) {
    points[33 * i] += test::normal_vector(rng, 40.0);
  }
  fit_spheroid(points, 1.0, distances);
  std::vector<double> inside;
  for (std::size_t i = 0; i < count; ++i) {
    if (i % 33 != 0) {
      inside.push_back(distances[i]);
    }
  }
  EXPECT_NEAR(rms(inside), 1.0, 0.06);
}

TEST(FeaturelessShape, ASphereFailsOnASpheroidAndBothOnAFace) {
  std::mt19937 rng(kShapeSeed);
  std::vector<double> distances(150);
  const auto spheroid = cloud(150, {78, 78, 95}, -1.0, 0.5, rng);
  fit_sphere(spheroid, 0.5, distances);
  EXPECT_GT(rms(distances), 3.0);
  const auto head = test::make_head(4);
  std::vector<Vector3d> face;
  for (const auto &spot : test::spots(head, 150, rng, [](const Vector3d &p) { return p.y() > 40.0; })) {
    face.push_back(spot.point_mm);
  }
  fit_spheroid(face, 0.5, distances);
  EXPECT_GT(rms(distances), 1.5) << "the nose";
}

} // namespace
} // namespace bregma::registration
