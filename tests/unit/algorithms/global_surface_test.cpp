// Global registration: the pose from any start, and no confident answer if the samples do not determine it.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "algorithms/registration/surface/global_surface.hpp"
#include "algorithms/registration/surface/pose_search.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
using geometry::frame::Source;
using geometry::frame::Target;

constexpr unsigned kGlobalSeed = 20260311;

struct SearchedHead {
  surface::TriangleMesh mesh = test::make_head(4);
  surface::SurfaceModel surface{mesh};
  surface::SurfaceField field{surface};
};
const SearchedHead &searched_head() {
  static const SearchedHead head;
  return head;
}

std::vector<Vector3d> shuffled_into(const auto &T_source_target, const std::vector<Vector3d> &places, double sigma_mm,
                                    std::mt19937 &rng) {
  std::vector<Vector3d> out;
  for (const Vector3d &p : places) {
    out.push_back(T_source_target * (p + test::normal_vector(rng, sigma_mm)));
  }
  return out;
}

// The face of the test head: its nose and the skin around.
std::vector<Vector3d> face_places(std::size_t count, std::mt19937 &rng) {
  std::vector<Vector3d> out;
  for (const auto &spot :
       test::spots(searched_head().mesh, count, rng, [](const Vector3d &p) { return p.y() > 0.0 && p.z() < 60.0; })) {
    out.push_back(spot.point_mm);
  }
  return out;
}

double worst_mm(const PairedPose &a, const PairedPose &b, const std::vector<Vector3d> &source) {
  double worst = 0.0;
  for (const Vector3d &p : source) {
    worst = std::max(worst, (a * p - b * p).norm());
  }
  return worst;
}

TEST(GlobalSurface, RotationsAreSpreadEvenly) {
  const auto rotations = spread_rotations(2000);
  std::mt19937 rng(kGlobalSeed);
  double farthest = 0.0;
  for (int i = 0; i < 500; ++i) {
    const Eigen::Quaterniond any = test::random_rotation(rng);
    double nearest = 10.0;
    for (const Eigen::Quaterniond &R : rotations) {
      ASSERT_NEAR(R.norm(), 1.0, 1e-12);
      nearest = std::min(nearest, geometry::angle_between(R, any));
    }
    farthest = std::max(farthest, nearest);
  }
  EXPECT_LT(farthest, 0.42) << "24 degrees, seed " << kGlobalSeed;
}

TEST(GlobalSurface, ASphereIsFitted) {
  std::mt19937 rng(kGlobalSeed);
  std::vector<Vector3d> points;
  for (int i = 0; i < 100; ++i) {
    points.push_back(Vector3d(10, 20, 30) + 70.0 * test::normal_vector(rng, 1.0).normalized());
  }
  const FittedSphere sphere = fit_sphere(points);
  EXPECT_NEAR(sphere.radius_mm, 70.0, 1e-6);
  EXPECT_NEAR((sphere.centre_mm - Vector3d(10, 20, 30)).norm(), 0.0, 1e-6);
}

TEST(GlobalSurface, AFaceIsNeverFoundWithAWrongPose) {
  std::mt19937 rng(kGlobalSeed);
  GlobalRegistration global(searched_head().field, GlobalOptions{});
  int found = 0;
  for (int run = 0; run < 12; ++run) {
    const auto places = face_places(150, rng);
    const auto T_true = test::random_pose<Target, Source>(rng);
    auto source = shuffled_into(T_true.inverse(), places, 0.5, rng);
    for (std::size_t i = 0; i < 4; ++i) {
      source[30 * i] += test::normal_vector(rng, 40.0); // outliers
    }
    const GlobalResult &result = global.locate(source);
    if (result.verdict == Verdict::kFound) {
      ++found;
      std::vector<Vector3d> clean = shuffled_into(T_true.inverse(), places, 0.0, rng);
      EXPECT_LT(worst_mm(result.T_target_source, T_true, clean), 10.0) << "run " << run << ", seed " << kGlobalSeed;
    }
    EXPECT_LE(result.hypotheses[0].probability, 1.0);
    for (std::size_t i = 1; i < result.hypothesis_count; ++i) {
      EXPECT_GE(result.hypotheses[i - 1].log_likelihood, result.hypotheses[i].log_likelihood);
    }
  }
  EXPECT_GE(found, 10) << "seed " << kGlobalSeed;
}

TEST(GlobalSurface, TheAnswerDoesNotDependOnThreadsNorOnTheSamplesFrame) {
  std::mt19937 rng(kGlobalSeed);
  const auto places = face_places(120, rng);
  const auto T_true = test::random_pose<Target, Source>(rng);
  const auto source = shuffled_into(T_true.inverse(), places, 0.5, rng);
  GlobalOptions options;
  GlobalRegistration one(searched_head().field, options);
  options.threads = 2;
  GlobalRegistration two(searched_head().field, options);
  const GlobalResult first = one.locate(source);
  const GlobalResult second = two.locate(source);
  EXPECT_EQ(first.T_target_source.matrix(), second.T_target_source.matrix());
  EXPECT_EQ(first.log_odds, second.log_odds);

  const auto M = test::random_pose<Source, Source>(rng);
  std::vector<Vector3d> moved;
  for (const Vector3d &p : source) {
    moved.push_back(M * p);
  }
  const GlobalResult elsewhere = one.locate(moved);
  EXPECT_EQ(elsewhere.verdict, first.verdict);
  EXPECT_LT(worst_mm(elsewhere.T_target_source * M, first.T_target_source, source), 0.5);
}

class NotFoundSurface : public testing::Test {
protected:
  void expect_not_found(const surface::SurfaceField &field, const std::vector<Vector3d> &places, std::mt19937 &rng) {
    GlobalRegistration global(field, GlobalOptions{});
    const auto T = test::random_pose<Target, Source>(rng);
    const GlobalResult &result = global.locate(shuffled_into(T.inverse(), places, 0.5, rng));
    EXPECT_NE(result.verdict, Verdict::kFound) << "seed " << kGlobalSeed;
    EXPECT_NE(result.reason, VerdictReason::kNone);
    EXPECT_FALSE(describe(result).empty());
    std::printf("%s\n", describe(result).c_str());
  }
  std::mt19937 rng_{kGlobalSeed};
};

TEST_F(NotFoundSurface, TheVaultAlone) {
  for (const std::size_t count : {40U, 150U, 500U}) {
    std::vector<Vector3d> places;
    for (const auto &spot :
         test::spots(searched_head().mesh, count, rng_, [](const Vector3d &p) { return p.z() > 70.0; })) {
      places.push_back(spot.point_mm);
    }
    expect_not_found(searched_head().field, places, rng_);
  }
}

TEST_F(NotFoundSurface, APlane) {
  std::uniform_real_distribution<double> across(-40.0, 40.0);
  std::vector<Vector3d> places;
  for (int i = 0; i < 150; ++i) {
    places.emplace_back(across(rng_), across(rng_), 0.0);
  }
  expect_not_found(searched_head().field, places, rng_);
}

TEST_F(NotFoundSurface, ASphereOnASphere) {
  const surface::SurfaceModel surface(test::make_sphere(4, 85.0, Vector3d::Zero()));
  const surface::SurfaceField field(surface);
  std::vector<Vector3d> places;
  for (int i = 0; i < 200; ++i) {
    places.push_back(85.0 * test::normal_vector(rng_, 1.0).normalized());
  }
  expect_not_found(field, places, rng_);
}

// Three distinct axes, but four equivalent poses.
TEST_F(NotFoundSurface, AnEllipsoidOnItself) {
  const Vector3d axes(70.0, 90.0, 105.0);
  auto mesh = test::make_sphere(4, 1.0, Vector3d::Zero());
  for (Vector3d &v : mesh.vertices_mm) {
    v = v.cwiseProduct(axes);
  }
  const surface::SurfaceModel surface(mesh);
  const surface::SurfaceField field(surface);
  std::vector<Vector3d> places;
  for (const auto &spot : test::spots(mesh, 200, rng_, [](const Vector3d &) { return true; })) {
    places.push_back(spot.point_mm);
  }
  expect_not_found(field, places, rng_);
}

TEST_F(NotFoundSurface, TooFewSamples) {
  expect_not_found(searched_head().field, face_places(kMinGlobalSamples - 1, rng_), rng_);
}

TEST_F(NotFoundSurface, AnotherHead) {
  auto places = face_places(200, rng_);
  for (Vector3d &p : places) {
    p *= 1.25;
  }
  expect_not_found(searched_head().field, places, rng_);
}

TEST(GlobalSurface, BadOptionsAreRefused) {
  GlobalOptions options;
  options.sigma_mm = 0.0;
  EXPECT_THROW(GlobalRegistration(searched_head().field, options), std::invalid_argument);
  options = GlobalOptions{};
  options.threads = 0;
  EXPECT_THROW(GlobalRegistration(searched_head().field, options), std::invalid_argument);
}

} // namespace
