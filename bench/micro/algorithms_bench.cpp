// Time of each algorithm in the loops: the first and the last run per tracker frame, the rest in the registration loop.
// Google Benchmark: --benchmark_format=json for JSON output, --benchmark_filter=REGEX for a selection.
#include <cmath>
#include <tuple>

#include <benchmark/benchmark.h>

#include "algorithms/monitoring/drift_monitor.hpp"
#include "algorithms/planning/critical_structures.hpp"
#include "algorithms/registration/registration.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using registration::Matrix3d;
using registration::Vector3d;
constexpr unsigned kSeed = 20260301;
constexpr int kFine = 5; // 10,242 vertices and 20,480 triangles, the size of a case's scalp

const surface::TriangleMesh &head() {
  static const surface::TriangleMesh mesh = test::make_head(kFine);
  return mesh;
}
const surface::SurfaceModel &scalp() {
  static const surface::SurfaceModel surface(head());
  return surface;
}

struct Patient {
  std::mt19937 rng{kSeed};
  registration::ImageFromReference T = test::random_pose<geometry::frame::Image, geometry::frame::Reference>(rng);
  std::vector<registration::FiducialObservation> fiducials;
  std::vector<registration::SurfaceSample> samples;
  std::vector<Vector3d> targets = {{12.0, -20.0, 5.0}};

  explicit Patient(std::size_t sample_count) {
    for (int i = 0; i < 8; ++i) {
      const Matrix3d touch = test::random_anisotropic(rng, 0.2, 0.4);
      const Matrix3d placed = 0.5 * 0.5 * Matrix3d::Identity();
      const Vector3d p = test::on_head(test::normal_vector(rng, 1.0));
      fiducials.push_back({T.inverse() * p + test::draw(rng, touch), touch, p + test::draw(rng, placed), placed});
    }
    const test::SmoothField skin(rng, 12.0);
    for (const auto &spot : test::spots(head(), sample_count, rng, [](const Vector3d &p) { return p.z() > 20.0; })) {
      samples.push_back({T.inverse() * (spot.point_mm + 0.7 * skin(spot.point_mm) * spot.normal),
                         0.15 * 0.15 * Matrix3d::Identity()});
    }
  }
};

// NOLINTBEGIN(clang-analyzer-deadcode.DeadStores): the loop variable of Google Benchmark is never read
void marker_fit_covariance(benchmark::State &state) {
  const std::vector<Vector3d> markers = {{0, 0, 0}, {50, 0, 0}, {0, 35, 0}, {-20, -30, 8}};
  std::mt19937 rng(kSeed);
  const geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool> T(test::random_rotation(rng),
                                                                            Vector3d(100, -50, -1900));
  for (auto _ : state) {
    benchmark::DoNotOptimize(registration::marker_fit_covariance(markers, 0b1111U, T, 0.10, 0.25));
  }
}
BENCHMARK(marker_fit_covariance);

void paired_fit_8_anisotropic(benchmark::State &state) {
  const Patient patient(1);
  std::vector<registration::PointPair> pairs;
  for (const auto &f : patient.fiducials) {
    pairs.push_back({f.reference_mm, f.image_mm, f.reference_covariance, f.image_covariance});
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(registration::fit_paired(pairs));
  }
}
BENCHMARK(paired_fit_8_anisotropic)->Unit(benchmark::kMicrosecond);

// Points 0 to 5 mm off the skin, each 1 mm from the previous one.
void surface_closest(benchmark::State &state, bool warm) {
  std::vector<Vector3d> path;
  for (int i = 0; i < 4096; ++i) {
    const double s = 0.01 * i;
    const Vector3d on = test::on_head({std::cos(s), std::sin(s), 0.2 + 0.02 * s});
    path.push_back(on + 2.5 * (1.0 + std::sin(3.0 * s)) * (on - test::kHeadCentre).normalized());
  }
  std::size_t i = 0;
  int last = -1;
  for (auto _ : state) {
    const auto found = scalp().closest(path[i], warm ? last : -1);
    last = found.triangle;
    i = (i + 1) % path.size();
    benchmark::DoNotOptimize(found);
  }
}
BENCHMARK_CAPTURE(surface_closest, cold, false);
BENCHMARK_CAPTURE(surface_closest, warm, true);

void surface_line_of_sight(benchmark::State &state) {
  std::mt19937 rng(kSeed);
  std::vector<Vector3d> ends;
  for (int i = 0; i < 1024; ++i) {
    ends.push_back(test::kHeadCentre + test::normal_vector(rng, 120.0));
  }
  const Vector3d camera(0.0, 900.0, 1700.0);
  std::size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(scalp().segment_hits(camera, ends[i]));
    i = (i + 1) % ends.size();
  }
}
BENCHMARK(surface_line_of_sight);

void joint_estimate_8_fiducials(benchmark::State &state, bool warm) {
  const Patient patient(static_cast<std::size_t>(state.range(0)));
  registration::RegistrationEstimator estimator(&scalp(), {});
  const auto start = estimator.estimate(patient.fiducials, patient.samples, patient.targets).T_image_reference;
  int iterations = 0;
  for (auto _ : state) {
    const auto &result =
        estimator.estimate(patient.fiducials, patient.samples, patient.targets, warm ? &start : nullptr);
    iterations = result.iterations;
    benchmark::DoNotOptimize(result.covariance);
  }
  state.counters["iterations"] = iterations;
}
// The samples are those of a range sensor: the excess on tilted skin is estimated too.
void joint_estimate_by_range_sensor(benchmark::State &state) {
  Patient patient(static_cast<std::size_t>(state.range(0)));
  for (registration::SurfaceSample &sample : patient.samples) {
    sample.towards_sensor = patient.T.inverse().rotation() * Vector3d::UnitZ();
    sample.across = patient.T.inverse().rotation() * Vector3d::UnitX();
  }
  registration::RegistrationEstimator estimator(&scalp(), {});
  int iterations = 0;
  for (auto _ : state) {
    const auto &result = estimator.estimate(patient.fiducials, patient.samples, patient.targets);
    iterations = result.iterations;
    benchmark::DoNotOptimize(result.covariance);
  }
  state.counters["iterations"] = iterations;
}
BENCHMARK_CAPTURE(joint_estimate_8_fiducials, cold, false)->Arg(300)->Arg(2000)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(joint_estimate_8_fiducials, warm, true)->Arg(300)->Arg(2000)->Unit(benchmark::kMillisecond);
BENCHMARK(joint_estimate_by_range_sensor)->Arg(300)->Arg(2000)->Unit(benchmark::kMillisecond);

std::vector<planning::NamedMesh> structures() {
  std::vector<planning::NamedMesh> out;
  for (const auto &[name, centre, radius] :
       {std::tuple("Precentral_L", Vector3d(-40, 0, 50), 18.0), std::tuple("Precentral_R", Vector3d(40, 0, 50), 18.0),
        std::tuple("Occipital_L", Vector3d(-26, -80, 5), 20.0), std::tuple("Occipital_R", Vector3d(26, -80, 5), 20.0),
        std::tuple("Heschl_L", Vector3d(-45, -20, 8), 9.0), std::tuple("Heschl_R", Vector3d(45, -20, 8), 9.0)}) {
    out.push_back({name, test::make_sphere(4, radius, centre)});
  }
  return out;
}

// Along a trajectory in steps of 20 um, like a probe at 5 mm/s tracked at 250 Hz.
void nearest_structure(benchmark::State &state, bool warm) {
  const planning::CriticalStructures critical(structures());
  planning::CriticalStructures::Warm last;
  double depth = 0.0;
  for (auto _ : state) {
    if (!warm) {
      last = {};
    }
    benchmark::DoNotOptimize(critical.nearest({5.0 + 0.2 * depth, 20.0 - 0.6 * depth, 90.0 - depth}, last));
    depth = depth < 70.0 ? depth + 0.02 : 0.0;
  }
}
BENCHMARK_CAPTURE(nearest_structure, cold, false)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(nearest_structure, warm, true)->Unit(benchmark::kMicrosecond);

void drift_check_touch(benchmark::State &state) {
  monitoring::DriftMonitor monitor;
  monitor.reset(1e-4 * geometry::Matrix6d::Identity());
  monitoring::CheckTouch touch;
  touch.touch_covariance = 0.1 * Matrix3d::Identity();
  touch.landmark_covariance = 0.1 * Matrix3d::Identity();
  for (auto _ : state) {
    touch.landmark = (touch.landmark + 1) % 4;
    monitor.add_check(touch);
    benchmark::DoNotOptimize(monitor.statistic());
  }
}
BENCHMARK(drift_check_touch)->Unit(benchmark::kMicrosecond);
// NOLINTEND(clang-analyzer-deadcode.DeadStores)

} // namespace
