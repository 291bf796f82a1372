// Properties of every registration method: equivariance under motions of both sides, inverse for exchanged sides, and
// composition.
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "algorithms/registration/clouds/cloud_pose.hpp"
#include "algorithms/registration/points/robust_points.hpp"
#include "algorithms/registration/registration.hpp"
#include "algorithms/registration/splines/curves.hpp"
#include "algorithms/registration/splines/thin_plate_spline.hpp"
#include "algorithms/registration/surface/global_surface.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
using geometry::Points3;

constexpr unsigned kPropertySeed = 20260320;
constexpr std::size_t kPlaces = 160;
constexpr std::size_t kFiducials = 8;

using Map = std::function<Vector3d(const Vector3d &)>;

// The skin at the front of the head with its normals. The first points serve as fiducials and landmarks.
struct Places {
  surface::TriangleMesh mesh = test::make_head(4);
  std::vector<Vector3d> points, normals;
  Places() {
    std::mt19937 rng(kPropertySeed);
    for (const auto &spot : test::spots(mesh, kPlaces, rng, [](const Vector3d &p) { return p.y() > -20.0; })) {
      points.push_back(spot.point_mm);
      normals.push_back(spot.normal);
    }
  }
};
const Places &places() {
  static const Places all;
  return all;
}

// One side of a registration: the head with errors of its points, at a pose.
struct Side {
  std::vector<Vector3d> head_mm = places().points;
  PairedPose placed;

  [[nodiscard]] Vector3d point(std::size_t i) const { return placed * head_mm[i]; }
  [[nodiscard]] std::vector<Vector3d> points() const {
    std::vector<Vector3d> out;
    for (std::size_t i = 0; i < head_mm.size(); ++i) {
      out.push_back(point(i));
    }
    return out;
  }
  [[nodiscard]] Points3 columns() const {
    Points3 out(3, static_cast<Eigen::Index>(head_mm.size()));
    for (std::size_t i = 0; i < head_mm.size(); ++i) {
      out.col(static_cast<Eigen::Index>(i)) = point(i);
    }
    return out;
  }
  // Covariance of a fiducial: an ellipsoid that moves with the head.
  [[nodiscard]] Matrix3d covariance(std::size_t i) const {
    const Vector3d n = places().normals[i];
    const Matrix3d R = placed.rotation_matrix();
    return R * (0.04 * Matrix3d::Identity() + 0.2 * n * n.transpose()) * R.transpose();
  }
};

// Distance fields, one per pose of the head, because building one takes a second.
struct PlacedHead {
  explicit PlacedHead(const PairedPose &placed) : mesh(places().mesh) {
    for (Vector3d &v : mesh.vertices_mm) {
      v = placed * v;
    }
    surface = std::make_unique<surface::SurfaceModel>(mesh);
    field = std::make_unique<surface::SurfaceField>(*surface);
  }
  surface::TriangleMesh mesh;
  std::unique_ptr<surface::SurfaceModel> surface;
  std::unique_ptr<surface::SurfaceField> field;
};
const PlacedHead &head_at(const PairedPose &placed) {
  static std::map<std::array<double, 3>, std::unique_ptr<PlacedHead>> heads;
  std::array<double, 3> key{};
  Vector3d::Map(key.data()) = placed.translation();
  auto &head = heads[key];
  if (!head) {
    head = std::make_unique<PlacedHead>(placed);
  }
  return *head;
}

Map as_map(const PairedPose &T) {
  return [T](const Vector3d &p) { return T * p; };
}

std::vector<PointPair> fiducial_pairs(const Side &source, const Side &target) {
  std::vector<PointPair> out;
  for (std::size_t i = 0; i < kFiducials; ++i) {
    out.push_back({source.point(i), target.point(i), source.covariance(i), target.covariance(i)});
  }
  return out;
}

struct LeastSquares {
  static constexpr double kTolerance_mm = 1e-8;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    return as_map(fit_rigid(source.points(), target.points()).value());
  }
};

struct MaximumLikelihood {
  static constexpr double kTolerance_mm = 1e-5;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    return as_map(fit_paired(fiducial_pairs(source, target)).T_target_source);
  }
};

struct RobustPoints {
  static constexpr double kTolerance_mm = 1e-5;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    auto pairs = fiducial_pairs(source, target);
    pairs[2].target_mm += target.placed.rotation() * Vector3d(0.0, 0.0, 30.0);
    const RobustFit fit = fit_paired_robust(pairs);
    EXPECT_TRUE(fit.found && fit.outliers == 1 && !fit.inlier[2]);
    return as_map(fit.fit.T_target_source);
  }
};

// Joint estimate from fiducials and skin, as in the daemon.
struct Joint {
  static constexpr double kTolerance_mm = 0.01;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    std::vector<FiducialObservation> fiducials;
    std::vector<SurfaceSample> samples;
    for (std::size_t i = 0; i < kPlaces; ++i) {
      if (i < kFiducials) {
        fiducials.push_back({source.point(i), source.covariance(i), target.point(i), target.covariance(i)});
      } else {
        samples.push_back({source.point(i), Matrix3d::Zero()});
      }
    }
    RegistrationEstimator estimator(head_at(target.placed).surface.get(), {});
    const auto &result = estimator.estimate(fiducials, samples, {});
    EXPECT_EQ(result.refusal, Refusal::kNone);
    return as_map(result.T_image_reference.as<geometry::frame::Target, geometry::frame::Source>());
  }
};

// Near the surface the closest points are exact. The first steps use voxels, which do not rotate with the surface.
template <SurfaceMetric metric> struct LocalOnMesh {
  static constexpr double kTolerance_mm = 0.05;
  static Map run(const Side &source, const Side &target, const PairedPose &start) {
    LocalOptions options;
    options.metric = metric;
    LocalRegistration local(*head_at(target.placed).field, options);
    return as_map(local.fit(source.points(), start).T_target_source);
  }
};
using LocalByPlanes = LocalOnMesh<SurfaceMetric::kPointToPlane>;

template <SurfaceMetric metric> struct LocalOnCloud {
  static constexpr double kTolerance_mm = 0.02;
  static Map run(const Side &source, const Side &target, const PairedPose &start) {
    std::vector<Vector3d> normals;
    for (const Vector3d &n : places().normals) {
      normals.push_back(target.placed.rotation() * n);
    }
    const surface::CloudModel cloud(target.points(), normals);
    LocalOptions options;
    options.metric = metric;
    LocalRegistration local(cloud, options);
    return as_map(local.fit(source.points(), start).T_target_source);
  }
};
using CloudByPlanes = LocalOnCloud<SurfaceMetric::kPointToPlane>;
using CloudByPoints = LocalOnCloud<SurfaceMetric::kPointToPoint>;

struct Global {
  static constexpr double kTolerance_mm = 0.1;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    GlobalRegistration global(*head_at(target.placed).field, {});
    return as_map(global.locate(source.points()).T_target_source);
  }
};

// The outliers' bounding box does not rotate with the targets, which causes small differences with noise.
template <CpdModel model> struct Drift {
  static constexpr double kTolerance_mm = 0.05;
  static Map run(const Side &source, const Side &target, const PairedPose &start) {
    CpdOptions options;
    options.model = model;
    options.outlier_weight = 0.01;
    const CpdTransform<3> from{start.rotation_matrix(), start.translation()};
    const auto found = register_cpd<3>(source.columns(), target.columns(), options, &from);
    EXPECT_TRUE(found.has_estimate());
    return [T = found.transform](const Vector3d &p) { return Vector3d(T.linear * p + T.translation); };
  }
};
using CpdRigid = Drift<CpdModel::kRigid>;
using CpdSimilarity = Drift<CpdModel::kSimilarity>;
using CpdAffine = Drift<CpdModel::kAffine>;

struct CloudFromAnyPose {
  static constexpr double kTolerance_mm = 0.05;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    CloudPoseOptions options;
    options.outlier_weight = 0.01;
    const auto found = find_cloud_pose(source.columns(), target.columns(), options).best;
    EXPECT_TRUE(found.has_estimate());
    return [T = found.transform](const Vector3d &p) { return Vector3d(T.linear * p + T.translation); };
  }
};

template <SplineKernel kernel> struct SplineThrough {
  static constexpr double kTolerance_mm = 1e-6;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    const auto spline = ThinPlateSpline<3>::fit(source.columns(), target.columns(), {.kernel = kernel});
    EXPECT_TRUE(spline.has_value());
    return [f = spline.value()](const Vector3d &p) { return f(p); };
  }
};
using SplineR = SplineThrough<SplineKernel::kR>;
using SplineR2LogR = SplineThrough<SplineKernel::kR2LogR>;

struct PointsAndCurves {
  static constexpr double kTolerance_mm = 1e-6;
  static Map run(const Side &source, const Side &target, const PairedPose & /*start*/) {
    // Here the source is the reference, from which the spline maps.
    const Points3 from = source.columns();
    const Points3 to = target.columns();
    const PointSets<3> landmarks{from.leftCols<kFiducials>(), to.leftCols<kFiducials>()};
    const std::vector<CurvePair<3>> curves{{from.middleCols(20, 6), to.middleCols(20, 6), 15, false},
                                           {from.middleCols(40, 5), to.middleCols(40, 5), 12, true}};
    const auto sets = join<3>(landmarks, curves).value();
    const auto spline = ThinPlateSpline<3>::fit(sets.reference_mm, sets.floating_mm, {.kernel = SplineKernel::kR});
    EXPECT_TRUE(spline.has_value());
    return [f = spline.value()](const Vector3d &p) { return f(p); };
  }
};

template <class Method> class RegistrationProperty : public testing::Test {
protected:
  RegistrationProperty() {
    std::mt19937 rng(kPropertySeed);
    for (Side *side : {&here_, &there_, &beyond_}) {
      side->placed = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
    }
  }

  // The true pose with an error of a few degrees about the head and a few mm.
  static PairedPose start(const Side &source, const Side &target) {
    const Eigen::Quaterniond turn = geometry::rotation_exp(Vector3d(0.02, -0.03, 0.025));
    const PairedPose off(turn, turn * -test::kHeadCentre + test::kHeadCentre + Vector3d(1.5, -1.0, 2.0));
    const auto head = target.placed.template as<geometry::frame::Target, geometry::frame::Target>();
    return head * off * source.placed.inverse().template as<geometry::frame::Source, geometry::frame::Source>();
  }
  static Map run(const Side &source, const Side &target) { return Method::run(source, target, start(source, target)); }

  static double farthest_mm(const Map &a, const Map &b, const std::vector<Vector3d> &at_mm) {
    double most = 0.0;
    for (const Vector3d &p : at_mm) {
      const double apart = (a(p) - b(p)).norm();
      most = apart >= most ? apart : most;
      most = std::isnan(apart) ? std::numeric_limits<double>::infinity() : most;
    }
    return most;
  }

  Side here_, there_, beyond_;
};

using Methods = testing::Types<LeastSquares, MaximumLikelihood, RobustPoints, Joint, LocalByPlanes, CloudByPlanes,
                               CloudByPoints, Global, CpdRigid, CpdSimilarity, CpdAffine, CloudFromAnyPose, SplineR,
                               SplineR2LogR, PointsAndCurves>;
class MethodNames {
public:
  // GoogleTest reports the function.
  template <class Method> static std::string GetName(int i) { // NOLINT(readability-identifier-naming)
    static const std::array<const char *, 15> kNames = {
        "LeastSquares",  "MaximumLikelihood", "RobustPoints", "Joint",        "LocalByPlanes",
        "CloudByPlanes", "CloudByPoints",     "Global",       "CpdRigid",     "CpdSimilarity",
        "CpdAffine",     "CloudFromAnyPose",  "SplineR",      "SplineR2LogR", "PointsAndCurves"};
    return kNames[static_cast<std::size_t>(i)];
  }
};
TYPED_TEST_SUITE(RegistrationProperty, Methods, MethodNames);

TYPED_TEST(RegistrationProperty, IsEquivariantOnBothSides) {
  std::mt19937 rng(kPropertySeed + 1);
  for (std::size_t i = 0; i < kPlaces; ++i) {
    this->here_.head_mm[i] += test::normal_vector(rng, 0.2);
    this->there_.head_mm[i] += test::normal_vector(rng, 0.2);
  }
  const Map plain = this->run(this->here_, this->there_);
  const auto M = test::random_pose<geometry::frame::Target, geometry::frame::Target>(rng);
  const auto N = test::random_pose<geometry::frame::Target, geometry::frame::Target>(rng);
  Side here = this->here_;
  Side there = this->there_;
  here.placed = M * here.placed;
  there.placed = N * there.placed;
  const Map moved = this->run(here, there);
  EXPECT_LT(this->farthest_mm([&](const Vector3d &p) { return Vector3d(moved(M * p)); },
                              [&](const Vector3d &p) { return Vector3d(N * plain(p)); }, this->here_.points()),
            TypeParam::kTolerance_mm)
      << "seed " << kPropertySeed;
}

TYPED_TEST(RegistrationProperty, SwappedSidesGiveTheInverse) {
  const Map forth = this->run(this->here_, this->there_);
  const Map back = this->run(this->there_, this->here_);
  EXPECT_LT(this->farthest_mm([&](const Vector3d &p) { return back(forth(p)); }, [](const Vector3d &p) { return p; },
                              this->here_.points()),
            TypeParam::kTolerance_mm)
      << "seed " << kPropertySeed;
}

TYPED_TEST(RegistrationProperty, CompositionOfRegistrationsIsARegistration) {
  const Map first = this->run(this->here_, this->there_);
  const Map second = this->run(this->there_, this->beyond_);
  const Map whole = this->run(this->here_, this->beyond_);
  EXPECT_LT(this->farthest_mm([&](const Vector3d &p) { return second(first(p)); }, whole, this->here_.points()),
            TypeParam::kTolerance_mm)
      << "seed " << kPropertySeed;
}

} // namespace
