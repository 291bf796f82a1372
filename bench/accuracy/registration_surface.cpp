// Surface registration, local and global: the figures of issue 3. Every study states its seed. Times of the local
// method are CPU times of its thread, which do not depend on other load. Times of the global method are wall times.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numeric>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/surface/global_surface.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "bench/accuracy/registration_basin.hpp"
#include "bench/accuracy/registration_parts.hpp"
#include "bench/accuracy/registration_peer.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::bench {

namespace {

using namespace registration;

constexpr unsigned kSurfaceSeed = 20260301;
constexpr double kSuccess_mm = 2.0;

double wall_ms() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <class... Values> std::string format(const char *pattern, Values... values) {
  std::array<char, 256> line{};
  std::snprintf(line.data(), line.size(), pattern, values...);
  return line.data();
}

double percent_below(const std::vector<double> &values, double limit) {
  const auto below = std::count_if(values.begin(), values.end(), [limit](double v) { return v <= limit; });
  return 100.0 * static_cast<double>(below) / static_cast<double>(values.size());
}

// The estimator's options for errors that are independent between samples, as in these simulations.
LocalOptions independent(double sigma_mm) {
  LocalOptions options;
  options.sigma_mm = sigma_mm;
  options.correlation_length_mm = 0.0;
  return options;
}

// RMSE of poses drawn from the Cramer-Rao bound of the trace, the minimum for an unbiased estimator.
void draw_from_bound(const Trace &trace, const surface::SurfaceModel &surface, double sigma_mm, std::mt19937 &rng,
                     std::vector<double> &rmse_mm) {
  const Vector3d middle = std::accumulate(trace.true_mm.begin(), trace.true_mm.end(), Vector3d(Vector3d::Zero())) /
                          static_cast<double>(trace.true_mm.size());
  Matrix6d information = Matrix6d::Zero();
  for (const Vector3d &p : trace.true_mm) {
    const geometry::Vector6d row = geometry::point_jacobian(p - middle).transpose() * surface.closest(p).normal;
    information += row * row.transpose() / (sigma_mm * sigma_mm);
  }
  const Eigen::LLT<Matrix6d> factor(information);
  constexpr int kDraws = 50;
  for (int i = 0; i < kDraws; ++i) {
    geometry::Vector6d draw;
    draw << test::normal_vector(rng, 1.0), test::normal_vector(rng, 1.0);
    const geometry::Vector6d twist = factor.matrixU().solve(draw);
    double squares = 0.0;
    for (const Vector3d &p : trace.true_mm) {
      squares += (geometry::point_jacobian(p - middle) * twist).squaredNorm();
    }
    rmse_mm.push_back(std::sqrt(squares / static_cast<double>(trace.true_mm.size())));
  }
}

void local_table(Report &report, const Head &head, const surface::SurfaceField &field, int runs) {
  report.note(format("local: %d starts 10-20 degrees and 10-20 mm off, one side of the head, noise 1 mm, seed %u; CPU "
                     "time of one thread; peer: PCL 1.13, point to plane, prebuilt tree%s",
                     runs, kSurfaceSeed, PclIcp::available() ? "" : " (NOT in this build: libpcl-dev is missing)"));
  LocalRegistration local(field, independent(1.0));
  PclIcp peer(head);
  const Vector3d middle = field.surface().centre_mm();
  struct Size {
    std::size_t count;
    double limit_ms, limit_success;
  };
  for (const Size &size : {Size{150, 0.6, 99.0}, Size{500, 1.5, 100.0}, Size{1000, 2.5, 100.0}}) {
    std::mt19937 rng(kSurfaceSeed);
    std::vector<double> errors, times, peer_errors, peer_times;
    Progress progress("local, " + std::to_string(size.count) + " points", runs);
    for (int run = 0; run < runs; ++run) {
      progress.step();
      const Trace trace = take_trace(side_of(head, size.count, run % 2 == 0, rng), 1.0, Noise::kAll, rng);
      std::uniform_real_distribution<double> off(10.0, 20.0);
      const double angle = off(rng) * geometry::kRadiansPerDegree;
      const double distance = off(rng);
      const PairedPose start = perturbed_start(trace.T_target_source, middle, angle, distance, rng);
      double begin = thread_ms();
      const PairedPose fitted = local.fit(trace.source_mm, start).T_target_source;
      times.push_back(thread_ms() - begin);
      errors.push_back(trace.rmse_mm(fitted));
      if (PclIcp::available()) {
        begin = thread_ms();
        const PairedPose of_peer = peer.fit(trace.source_mm, start);
        peer_times.push_back(thread_ms() - begin);
        peer_errors.push_back(trace.rmse_mm(of_peer));
      }
    }
    const std::string name = "surface.local." + std::to_string(size.count);
    const auto add = [&](Record record, double peer_value) {
      report.add(PclIcp::available() ? with_peer(std::move(record), peer_value, "PCL") : record);
    };
    const bool with = PclIcp::available();
    add(at_least(name + ".within_2mm", percent_below(errors, kSuccess_mm), "%", size.limit_success),
        with ? percent_below(peer_errors, kSuccess_mm) : 0.0);
    const double median_ms = percentile(times, 0.5);
    add(at_most(name + ".time.median", median_ms, "ms", size.limit_ms), with ? percentile(peer_times, 0.5) : 0.0);
    report.add(figure(name + ".time.p95", percentile(times, 0.95), "ms"));
    add(figure(name + ".rmse.median", percentile(errors, 0.5), "mm"), with ? percentile(peer_errors, 0.5) : 0.0);
    if (with) {
      report.add(at_least(name + ".times_faster_than_pcl", percentile(peer_times, 0.5) / median_ms, "", 10.0));
    }
  }
}

void global_table(Report &report, const Head &head, const surface::SurfaceField &field, int runs) {
  report.note(
      format("global: %d starts over all of SO(3), one side of the head, noise 1 mm, seed %u, %d threads; floor: "
             "the local method from the true pose; bound: poses drawn from the Cramer-Rao bound",
             runs, kSurfaceSeed, kThreads));
  GlobalOptions options;
  options.threads = kThreads;
  GlobalRegistration global(field, options);
  LocalRegistration local(field, independent(1.0));
  struct Size {
    std::size_t count;
    double limit_success;
  };
  int wrong = 0;
  for (const Size &size : {Size{30, 80.0}, Size{60, 95.0}, Size{150, 99.0}, Size{1000, 100.0}}) {
    std::mt19937 rng(kSurfaceSeed);
    std::mt19937 bound_rng(kSurfaceSeed);
    std::vector<double> errors, floor, bound, times;
    int found = 0;
    Progress progress("global, " + std::to_string(size.count) + " points", runs);
    for (int run = 0; run < runs; ++run) {
      progress.step();
      const Trace trace = take_trace(side_of(head, size.count, run % 2 == 0, rng), 1.0, Noise::kAll, rng);
      const double begin = wall_ms();
      const GlobalResult &result = global.locate(trace.source_mm);
      times.push_back(wall_ms() - begin);
      errors.push_back(trace.rmse_mm(result.T_target_source));
      floor.push_back(trace.rmse_mm(local.fit(trace.source_mm, trace.T_target_source).T_target_source));
      draw_from_bound(trace, field.surface(), 1.0, bound_rng, bound);
      found += result.verdict == Verdict::kFound ? 1 : 0;
      wrong += result.verdict == Verdict::kFound && errors.back() > kWrong_mm ? 1 : 0;
    }
    const std::string name = "surface.global." + std::to_string(size.count);
    report.add(with_peer(at_least(name + ".within_2mm", percent_below(errors, kSuccess_mm), "%", size.limit_success),
                         percent_below(floor, kSuccess_mm), "floor"));
    report.add(figure(name + ".within_2mm.bound", percent_below(bound, kSuccess_mm), "%"));
    report.add(
        with_peer(figure(name + ".rmse.median", percentile(errors, 0.5), "mm"), percentile(floor, 0.5), "floor"));
    report.add(figure(name + ".rmse.median.bound", percentile(bound, 0.5), "mm"));
    report.add(figure(name + ".found", 100.0 * found / runs, "%"));
    const double median_ms = percentile(times, 0.5);
    report.add(size.count == 150 ? at_most(name + ".time.median", median_ms, "ms", 100.0)
                                 : figure(name + ".time.median", median_ms, "ms"));
  }
  report.add(at_most("surface.global.wrong_as_found", wrong, "runs", 0.0));
}

// Clouds that do not determine a pose, or that are not a head.
void degenerate(Report &report, const Head &head, const surface::SurfaceField &field, int runs) {
  GlobalOptions options;
  options.threads = kThreads;
  GlobalRegistration global(field, options);
  const auto mesh_places = [&](std::size_t count, std::mt19937 &rng, const auto &wanted) {
    std::vector<Vector3d> out;
    for (const auto &spot : test::spots(head.mesh, count, rng, wanted)) {
      out.push_back(spot.point_mm);
    }
    return out;
  };
  const auto round = [&](std::size_t count, std::mt19937 &rng, const Vector3d &axes, double above) {
    std::vector<Vector3d> out;
    while (out.size() < count) {
      const Vector3d direction = test::normal_vector(rng, 1.0).normalized();
      if (direction.z() > above) {
        out.push_back(direction.cwiseProduct(axes));
      }
    }
    return out;
  };
  using Maker = std::function<std::vector<Vector3d>(std::size_t, std::mt19937 &)>;
  const std::vector<std::pair<std::string, Maker>> clouds{
      {"vault", [&](std::size_t n,
                    std::mt19937 &rng) { return mesh_places(n, rng, [](const Vector3d &p) { return p.z() > 55.0; }); }},
      {"plane",
       [](std::size_t n, std::mt19937 &rng) {
         std::uniform_real_distribution<double> across(-40.0, 40.0);
         std::vector<Vector3d> out;
         for (std::size_t i = 0; i < n; ++i) {
           out.emplace_back(across(rng), across(rng), 0.0);
         }
         return out;
       }},
      {"sphere_cap", [&](std::size_t n, std::mt19937 &rng) { return round(n, rng, Vector3d::Constant(85.0), 0.3); }},
      {"spheroid", [&](std::size_t n, std::mt19937 &rng) { return round(n, rng, Vector3d(78.0, 78.0, 95.0), -1.0); }}};
  constexpr std::array<std::size_t, 4> kSizes{30, 60, 150, 500};
  report.note(
      format("clouds that fix no pose: %d each, 30, 60, 150 and 500 points in turn, noise 1 mm, seed %u; vault: z "
             "above 55 mm",
             runs, kSurfaceSeed));
  for (const auto &[name, make] : clouds) {
    std::mt19937 rng(kSurfaceSeed);
    int not_found = 0;
    Progress progress("no pose: " + name, runs);
    for (int run = 0; run < runs; ++run) {
      progress.step();
      const std::size_t n = kSizes[static_cast<std::size_t>(run) % kSizes.size()];
      const Trace trace = take_trace(make(n, rng), 1.0, Noise::kAll, rng);
      not_found += global.locate(trace.source_mm).verdict != Verdict::kFound ? 1 : 0;
    }
    report.add(at_least("surface.degenerate." + name + ".not_found", not_found, "runs", runs));
  }
}

// Coverage: how often the true error at a deep target lies inside the predicted 95 % ellipsoid.
void coverage(Report &report, const Head &head, const surface::SurfaceField &field, int runs) {
  constexpr double kSkinSigma_mm = 0.7;
  constexpr double kSkinLength_mm = 12.0;
  constexpr std::size_t kSamples = 200;
  const Vector3d target = field.surface().centre_mm();
  for (const bool correlated : {false, true}) {
    std::mt19937 rng(kSurfaceSeed);
    LocalOptions options = independent(kSkinSigma_mm);
    options.correlation_length_mm = correlated ? kSkinLength_mm : 0.0;
    LocalRegistration local(field, options);
    int inside = 0;
    double squared_true = 0.0;
    double squared_predicted = 0.0;
    Progress progress(correlated ? "coverage, correlated" : "coverage, independent", runs);
    for (int run = 0; run < runs; ++run) {
      progress.step();
      const test::SmoothField field_error(rng, kSkinLength_mm);
      std::normal_distribution<double> own(0.0, kSkinSigma_mm);
      std::vector<Vector3d> places;
      for (const auto &spot : test::spots(head.mesh, kSamples, rng, [](const Vector3d &p) { return p.y() > 0.0; })) {
        places.push_back(spot.point_mm +
                         spot.normal * (correlated ? kSkinSigma_mm * field_error(spot.point_mm) : own(rng)));
      }
      const Trace trace = take_trace(std::move(places), 0.0, Noise::kAll, rng);
      const PairedPose start =
          perturbed_start(trace.T_target_source, target, 3.0 * geometry::kRadiansPerDegree, 3.0, rng);
      const LocalFit &fit = local.fit(trace.source_mm, start);
      const Vector3d error = fit.T_target_source * (trace.T_target_source.inverse() * target) - target;
      const Matrix3d predicted = uncertainty::tre_covariance(fit.covariance, target);
      inside +=
          uncertainty::mahalanobis_squared(predicted, error) <= uncertainty::chi_square_upper_quantile(0.05, 3) ? 1 : 0;
      squared_true += error.squaredNorm() / runs;
      squared_predicted += predicted.trace() / runs;
    }
    const std::string name = std::string("surface.coverage.") + (correlated ? "alike_over_12mm" : "independent");
    const double percent = 100.0 * inside / runs;
    report.note(format("%s: %d runs, %zu samples of the front half, errors of 0.7 mm along the normal; RMS TRE at the "
                       "middle %.3f mm, predicted %.3f mm",
                       name.c_str(), runs, kSamples, std::sqrt(squared_true), std::sqrt(squared_predicted)));
    report.add(at_least(name, percent, "%", 93.0));
    report.add(at_most(name + ".not_more", percent, "%", 97.0));
  }
}

} // namespace

void surface_figures(Report &report, const RegistrationBenchOptions &options) {
  constexpr std::array kParts{"local", "global", "table1", "degenerate", "coverage", "basin"};
  if (std::none_of(kParts.begin(), kParts.end(), [&](const char *part) { return options.wants(part); })) {
    return;
  }
  const Head head = load_head(options.case_folder);
  const double begin = wall_ms();
  const surface::SurfaceModel surface(head.mesh);
  const surface::SurfaceField field(surface);
  const GlobalRegistration prepared(field, GlobalOptions{});
  report.add(at_most("surface.prepare", wall_ms() - begin, "ms", 2000.0));
  const bool quick = options.quick;
  if (options.wants("local")) {
    local_table(report, head, field, quick ? 40 : 200);
  }
  if (options.wants("global")) {
    global_table(report, head, field, quick ? 20 : 200);
  }
  if (options.wants("table1")) {
    table1_figures(report, options, head, field);
  }
  if (options.wants("degenerate")) {
    degenerate(report, head, field, quick ? 20 : 100);
  }
  if (options.wants("coverage")) {
    coverage(report, head, field, quick ? 200 : 2000);
  }
  if (options.wants("basin") && !options.basin_file.empty()) {
    draw_basin(report, head, field, options.basin_file, quick ? 4 : 25);
  }
}

} // namespace bregma::bench
