// Local registration to meshes and clouds: correct on analytic shapes, invariant under rigid motion, and with large
// covariance for undetermined directions.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/surface/local_surface.hpp"
#include "algorithms/registration/surface/normal_kernel.hpp"
#include "algorithms/registration/surface/plane_kernel.hpp"
#include "algorithms/registration/surface/plane_step.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
using geometry::frame::Source;
using geometry::frame::Target;

constexpr unsigned kLocalSeed = 20260310;

struct PreparedHead {
  surface::TriangleMesh mesh = test::make_head(4);
  surface::SurfaceModel surface{mesh};
  surface::SurfaceField field{surface};
};
const PreparedHead &prepared_head() {
  static const PreparedHead head;
  return head;
}

struct Sampled {
  std::vector<Vector3d> true_mm, source_mm;
  PairedPose T_true;
  [[nodiscard]] double rmse_mm(const PairedPose &T) const {
    double squares = 0.0;
    for (const Vector3d &p : true_mm) {
      squares += (T * (T_true.inverse() * p) - p).squaredNorm();
    }
    return std::sqrt(squares / static_cast<double>(true_mm.size()));
  }
};

Sampled sample_front(std::size_t count, double sigma_mm, std::mt19937 &rng) {
  Sampled out;
  out.T_true = test::random_pose<Target, Source>(rng);
  for (const auto &spot :
       test::spots(prepared_head().mesh, count, rng, [](const Vector3d &p) { return p.y() > 0.0; })) {
    out.true_mm.push_back(spot.point_mm);
    out.source_mm.push_back(out.T_true.inverse() * (spot.point_mm + test::normal_vector(rng, sigma_mm)));
  }
  return out;
}

PairedPose off(const PairedPose &T, double degrees, double mm, std::mt19937 &rng) {
  const Vector3d axis = test::normal_vector(rng, 1.0).normalized();
  const Vector3d way = test::normal_vector(rng, 1.0).normalized();
  const Eigen::Quaterniond turn = geometry::rotation_exp(degrees * geometry::kRadiansPerDegree * axis);
  const Vector3d middle = test::kHeadCentre;
  return {turn * T.rotation(), turn * (T.translation() - middle) + middle + mm * way};
}

LocalOptions without_correlation() {
  LocalOptions options;
  options.correlation_length_mm = 0.0;
  return options;
}

TEST(SurfaceField, ClosestPointsAreThoseOfTheTree) {
  std::mt19937 rng(kLocalSeed);
  for (int i = 0; i < 3000; ++i) {
    const Vector3d p = test::on_head(test::normal_vector(rng, 1.0)) + test::normal_vector(rng, i % 2 == 0 ? 2.0 : 30.0);
    const surface::SurfacePoint exact = prepared_head().surface.closest(p);
    const surface::SurfacePoint quick = prepared_head().field.closest(p);
    ASSERT_NEAR(quick.signed_mm, exact.signed_mm, 1e-9) << "point " << i << ", seed " << kLocalSeed;
  }
}

// A moving point: the cache of the last query is used only while it is exact.
TEST(SurfaceField, WarmQueriesStayExact) {
  std::mt19937 rng(kLocalSeed);
  int same = 0;
  constexpr int kSteps = 400;
  for (int walk = 0; walk < 20; ++walk) {
    Vector3d p = test::on_head(test::normal_vector(rng, 1.0)) + test::normal_vector(rng, 1.0);
    surface::SurfaceField::Nearby known;
    for (int i = 0; i < kSteps; ++i) {
      const Vector3d last_query = known.at_mm;
      const surface::SurfacePoint quick = prepared_head().field.closest(p, known);
      same += i > 0 && known.at_mm == last_query ? 1 : 0;
      const surface::SurfacePoint exact = prepared_head().surface.closest(p);
      ASSERT_NEAR(quick.signed_mm, exact.signed_mm, 1e-9) << "walk " << walk << ", step " << i;
      ASSERT_NEAR((quick.point_mm - exact.point_mm).norm(), 0.0, 1e-6) << "walk " << walk << ", step " << i;
      p += test::normal_vector(rng, i % 40 == 39 ? 1.0 : 0.01);
    }
  }
  EXPECT_GT(same, 20 * kSteps / 4) << "the tree or the lists were asked again and again";
}

TEST(SurfaceField, PlanesAreNearTheSurfacesDistance) {
  std::mt19937 rng(kLocalSeed);
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p = test::on_head(test::normal_vector(rng, 1.0)) + test::normal_vector(rng, 10.0);
    const surface::SurfaceField::Plane &plane = prepared_head().field.plane(p.cast<float>());
    const double distance = static_cast<double>(plane.normal.dot(p.cast<float>()) + plane.offset);
    // The error of a plane in a voxel of 4 mm follows from the curvature and the distance to the voxel's centre.
    ASSERT_NEAR(distance, prepared_head().surface.closest(p).signed_mm, 7.0) << "point " << i;
  }
}

TEST(SurfaceField, AMeshInTheWrongUnitIsRefused) {
  const surface::SurfaceModel huge(test::make_sphere(1, 20000.0, Vector3d::Zero()));
  EXPECT_THROW(surface::SurfaceField{huge}, std::invalid_argument);
}

// Compared with the formulas, sample by sample in double precision.
TEST(PlaneKernel, EveryVersionOfThisProcessorGivesTheFormulas) {
  std::mt19937 rng(kLocalSeed);
  const surface::SurfaceField &field = prepared_head().field;
  for (const std::size_t count : {1U, 7U, 8U, 61U, 200U}) {
    const Sampled trace = sample_front(count, 3.0, rng);
    const PairedPose T = off(trace.T_true, 10.0, 10.0, rng);
    SampleLanes lanes(count);
    std::vector<double> residuals;
    Matrix6d normal = Matrix6d::Zero();
    geometry::Vector6d gradient = geometry::Vector6d::Zero();
    double cost = 0.0;
    constexpr double kReach_mm = 12.0;
    for (std::size_t i = 0; i < count; ++i) {
      lanes.set(i, trace.source_mm[i]);
      const Vector3d p = T * trace.source_mm[i];
      const surface::SurfaceField::Plane &plane = field.plane(p.cast<float>());
      const Vector3d n = plane.normal.cast<double>();
      const double r = n.dot(p) + static_cast<double>(plane.offset);
      const double falloff = kReach_mm * kReach_mm / (kReach_mm * kReach_mm + r * r);
      geometry::Vector6d J;
      J << (p - test::kHeadCentre).cross(n), n;
      normal += falloff * falloff * J * J.transpose();
      gradient += falloff * falloff * r * J;
      cost += 1.0 - falloff;
      residuals.push_back(std::abs(r));
    }
    PlaneQuery query{field.grid(), lanes.axis(0), lanes.axis(1), lanes.axis(2), count, {}, {}};
    Eigen::Map<Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(query.rotation.data()) = T.rotation_matrix().cast<float>();
    Eigen::Vector3f::Map(query.translation.data()) = T.translation().cast<float>();
    std::array<float, 3> centre{};
    Eigen::Vector3f::Map(centre.data()) = test::kHeadCentre.cast<float>();
    for (const PlaneKernel &kernel : plane_kernels()) {
      SCOPED_TRACE(std::string(kernel.name) + ", " + std::to_string(count) + " samples");
      std::vector<float> each(whole_lanes(count), -1.0F);
      kernel.residuals(query, each.data());
      for (std::size_t i = 0; i < count; ++i) { // a sample on the border of two voxels may belong to either
        ASSERT_NEAR(static_cast<double>(each[i]), residuals[i], 1e-3);
      }
      for (std::size_t i = count; i < each.size(); ++i) {
        EXPECT_EQ(each[i], std::numeric_limits<float>::infinity());
      }
      std::vector<float> sorted(each.begin(), each.begin() + static_cast<std::ptrdiff_t>(count));
      std::sort(sorted.begin(), sorted.end());
      EXPECT_EQ(kernel.ranked(each.data(), count, count / 2), sorted[count / 2]);
      EXPECT_EQ(kernel.ranked(each.data(), count, 0), sorted.front());
      EXPECT_EQ(kernel.ranked(each.data(), count, count - 1), sorted.back());
      PlaneSums sums;
      kernel.sums(query, centre, static_cast<float>(kReach_mm * kReach_mm), sums);
      for (Eigen::Index a = 0, k = 0; a < 6; ++a) {
        const double size = std::sqrt(normal(a, a));
        EXPECT_NEAR(static_cast<double>(sums.gradient[static_cast<std::size_t>(a)]), gradient[a],
                    1e-4 * size * static_cast<double>(count));
        for (Eigen::Index b = 0; b <= a; ++b, ++k) {
          EXPECT_NEAR(static_cast<double>(sums.normal[static_cast<std::size_t>(k)]), normal(a, b),
                      1e-4 * size * std::sqrt(normal(b, b)));
        }
      }
      EXPECT_NEAR(static_cast<double>(sums.cost), cost, 1e-4 * static_cast<double>(count));
      EXPECT_NEAR(static_cast<double>(kernel.cost(query, static_cast<float>(kReach_mm * kReach_mm))), cost,
                  1e-4 * static_cast<double>(count));
    }
  }
}

TEST(NormalKernel, EveryVersionOfThisProcessorGivesTheSums) {
  std::mt19937 rng(kLocalSeed);
  for (const std::size_t count : {1U, 4U, 7U, 100U}) {
    NormalRows rows(count);
    Matrix6d plain = Matrix6d::Zero();
    Matrix6d squared = Matrix6d::Zero();
    geometry::Vector6d gradient = geometry::Vector6d::Zero();
    for (std::size_t i = 0; i < count; ++i) {
      geometry::Vector6d J;
      J << test::normal_vector(rng, 80.0), test::normal_vector(rng, 1.0);
      const Vector3d others = test::normal_vector(rng, 1.0);
      rows.set(i, J.head<3>(), J.tail<3>(), others.x());
      rows.set_weight(i, others.y() * others.y());
      plain += rows.weight(i) * J * J.transpose();
      squared += rows.weight(i) * rows.weight(i) * J * J.transpose();
      gradient += rows.weight(i) * others.x() * J;
      EXPECT_EQ(rows.jacobian(i), J);
    }
    rows.pad(count);
    for (const NormalKernel &kernel : normal_kernels()) {
      SCOPED_TRACE(std::string(kernel.name) + ", " + std::to_string(count) + " rows");
      NormalSums sums;
      NormalSums of_squares;
      kernel.sums(rows, count, false, sums);
      kernel.sums(rows, count, true, of_squares);
      for (Eigen::Index a = 0, k = 0; a < 6; ++a) {
        EXPECT_NEAR(sums.gradient[static_cast<std::size_t>(a)], gradient[a], 1e-12 * plain.norm());
        for (Eigen::Index b = 0; b <= a; ++b, ++k) {
          EXPECT_NEAR(sums.normal[static_cast<std::size_t>(k)], plain(a, b), 1e-12 * plain.norm());
          EXPECT_NEAR(of_squares.normal[static_cast<std::size_t>(k)], squared(a, b), 1e-12 * squared.norm());
        }
      }
    }
  }
}

TEST(LocalSurface, NoiselessSamplesGiveThePoseItself) {
  std::mt19937 rng(kLocalSeed);
  const Sampled samples = sample_front(200, 0.0, rng);
  LocalRegistration local(prepared_head().field, without_correlation());
  const LocalFit &fit = local.fit(samples.source_mm, off(samples.T_true, 10.0, 10.0, rng));
  EXPECT_TRUE(fit.converged);
  EXPECT_LT(samples.rmse_mm(fit.T_target_source), 0.05);
  EXPECT_EQ(fit.inliers, 200);
}

TEST(LocalSurface, OutliersAreLeftOutByEveryRobustLossAndByTrimming) {
  std::mt19937 rng(kLocalSeed);
  Sampled samples = sample_front(300, 0.5, rng);
  for (std::size_t i = 0; i < 30; ++i) {
    samples.source_mm[10 * i] += test::normal_vector(rng, 30.0);
  }
  LocalOptions trimmed = without_correlation();
  trimmed.loss = RobustLoss::kSquare;
  trimmed.trim = 0.15;
  std::vector<LocalOptions> all{trimmed};
  for (const RobustLoss loss :
       {RobustLoss::kHuber, RobustLoss::kTukey, RobustLoss::kGemanMcClure, RobustLoss::kHampel}) {
    all.push_back(without_correlation());
    all.back().loss = loss;
  }
  const PairedPose start = off(samples.T_true, 8.0, 8.0, rng);
  for (const LocalOptions &options : all) {
    LocalRegistration local(prepared_head().field, options);
    EXPECT_LT(samples.rmse_mm(local.fit(samples.source_mm, start).T_target_source), 1.5)
        << "loss " << static_cast<int>(options.loss) << ", seed " << kLocalSeed;
  }
}

TEST(LocalSurface, CloudsByPlanesAndByPoints) {
  std::mt19937 rng(kLocalSeed);
  const Sampled samples = sample_front(200, 0.0, rng);
  std::vector<Vector3d> points, normals;
  for (const auto &spot : test::spots(prepared_head().mesh, 6000, rng, [](const Vector3d &) { return true; })) {
    points.push_back(spot.point_mm);
    normals.push_back(spot.normal);
  }
  const PairedPose start = off(samples.T_true, 4.0, 4.0, rng);
  const surface::CloudModel with_normals(points, normals);
  LocalRegistration by_planes(with_normals, without_correlation());
  EXPECT_LT(samples.rmse_mm(by_planes.fit(samples.source_mm, start).T_target_source), 0.5);

  // Uses identical points, because point-to-point fits to other points of the surface stop at local minima.
  const surface::CloudModel bare(samples.true_mm);
  LocalOptions options = without_correlation();
  options.metric = SurfaceMetric::kPointToPoint;
  LocalRegistration by_points(bare, options);
  EXPECT_LT(samples.rmse_mm(by_points.fit(samples.source_mm, off(samples.T_true, 2.0, 2.0, rng)).T_target_source),
            1e-2);
  EXPECT_THROW(LocalRegistration(bare, without_correlation()), std::invalid_argument);
}

TEST(LocalSurface, TheKdTreeFindsTheNearestPoint) {
  std::mt19937 rng(kLocalSeed);
  std::vector<Vector3d> points;
  for (int i = 0; i < 500; ++i) {
    points.push_back(test::normal_vector(rng, 50.0));
  }
  const surface::CloudModel cloud(points);
  for (int i = 0; i < 500; ++i) {
    const Vector3d p = test::normal_vector(rng, 60.0);
    double nearest = std::numeric_limits<double>::infinity();
    for (const Vector3d &q : points) {
      nearest = std::min(nearest, (p - q).norm());
    }
    const surface::SurfacePoint found = cloud.closest(p);
    ASSERT_NEAR(found.distance_mm, nearest, 1e-12);
    ASSERT_EQ(points[static_cast<std::size_t>(found.triangle)], found.point_mm);
  }
}

// A motion M of the samples changes the result by M^-1. A motion of the surface changes it by M, up to the voxel grid.
TEST(LocalSurface, IsEquivariant) {
  std::mt19937 rng(kLocalSeed);
  const Sampled samples = sample_front(200, 0.5, rng);
  const PairedPose start = off(samples.T_true, 5.0, 5.0, rng);
  LocalRegistration local(prepared_head().field, without_correlation());
  const PairedPose plain = local.fit(samples.source_mm, start).T_target_source;

  const auto M = test::random_pose<Source, Source>(rng);
  std::vector<Vector3d> moved;
  for (const Vector3d &p : samples.source_mm) {
    moved.push_back(M * p);
  }
  const PairedPose of_moved = local.fit(moved, start * M.inverse()).T_target_source;
  EXPECT_LT(samples.rmse_mm(of_moved * M), samples.rmse_mm(plain) + 0.05);
  for (const Vector3d &p : samples.source_mm) {
    EXPECT_LT((of_moved * (M * p) - plain * p).norm(), 0.05);
  }

  const auto N = test::random_pose<Target, Target>(rng);
  surface::TriangleMesh mesh = prepared_head().mesh;
  for (Vector3d &v : mesh.vertices_mm) {
    v = N * v;
  }
  const surface::SurfaceModel surface(mesh);
  const surface::SurfaceField field(surface);
  LocalRegistration elsewhere(field, without_correlation());
  const PairedPose on_moved = elsewhere.fit(samples.source_mm, N * start).T_target_source;
  for (const Vector3d &p : samples.source_mm) {
    EXPECT_LT((N.inverse() * (on_moved * p) - plain * p).norm(), 0.05);
  }
}

TEST(LocalSurface, TheCovarianceShowsFreeRotationsOfASphere) {
  std::mt19937 rng(kLocalSeed);
  const auto mesh = test::make_sphere(4, 80.0, Vector3d::Zero());
  const surface::SurfaceModel surface(mesh);
  const surface::SurfaceField field(surface);
  LocalRegistration local(field, without_correlation());
  std::vector<Vector3d> source;
  for (int i = 0; i < 200; ++i) {
    source.push_back(80.0 * test::normal_vector(rng, 1.0).normalized());
  }
  const LocalFit &fit = local.fit(source, PairedPose());
  const double turn = fit.covariance.topLeftCorner<3, 3>().trace();
  EXPECT_TRUE(!std::isfinite(turn) || 80.0 * std::sqrt(turn) > 5.0) << "rotation variance " << turn;
}

TEST(LocalSurface, CorrelatedSamplesHaveASmallerEffectiveNumber) {
  std::mt19937 rng(kLocalSeed);
  const Sampled samples = sample_front(300, 0.5, rng);
  LocalRegistration independent(prepared_head().field, without_correlation());
  LocalRegistration correlated(prepared_head().field, LocalOptions{});
  const LocalFit one = independent.fit(samples.source_mm, samples.T_true);
  const LocalFit other = correlated.fit(samples.source_mm, samples.T_true);
  EXPECT_GT(other.covariance.trace(), 1.5 * one.covariance.trace());
  EXPECT_LT(other.effective, 0.5 * one.effective);
}

TEST(LocalSurface, BadInputIsNotConvergedAndBadOptionsAreRefused) {
  LocalRegistration local(prepared_head().field, LocalOptions{});
  const std::vector<Vector3d> few(5, Vector3d::Zero());
  EXPECT_FALSE(local.fit(few, PairedPose()).converged);
  const std::vector<Vector3d> nothing(50, Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_FALSE(local.fit(nothing, PairedPose()).converged);
  EXPECT_EQ(local.fit(nothing, PairedPose()).count, 0);
  LocalOptions bad;
  bad.sigma_mm = 0.0;
  EXPECT_THROW(LocalRegistration(prepared_head().field, bad), std::invalid_argument);
  bad = LocalOptions{};
  bad.trim = 1.0;
  EXPECT_THROW(LocalRegistration(prepared_head().field, bad), std::invalid_argument);
  const std::vector<Vector3d> flat(2, Vector3d::Zero());
  const std::vector<Vector3d> no_normal(2, Vector3d::Zero());
  EXPECT_THROW(surface::CloudModel(flat, no_normal), std::invalid_argument);
  EXPECT_THROW(surface::CloudModel(std::span<const Vector3d>{}), std::invalid_argument);
}

TEST(LocalSurface, AFitDoesNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "a sanitizer counts instead";
  }
  std::mt19937 rng(kLocalSeed);
  const Sampled samples = sample_front(300, 0.5, rng);
  const PairedPose start = off(samples.T_true, 8.0, 8.0, rng);
  LocalRegistration local(prepared_head().field, LocalOptions{});
  const test::AllocationScope scope;
  const LocalFit &fit = local.fit(samples.source_mm, start);
  EXPECT_EQ(scope.count(), 0U);
  EXPECT_TRUE(fit.converged);
}

} // namespace
