// Figures of paired points.
#include <optional>
#include <random>
#include <vector>

#include "algorithms/registration/points/robust_points.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "bench/accuracy/registration_parts.hpp"
#include "bench/accuracy/registration_study.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::bench {

namespace {

using namespace registration;

void paired_figures(Report &report, bool quick) {
  std::mt19937 rng(kStudySeed);
  std::vector<double> ours;
  std::vector<double> plain;
  std::vector<double> robust;
  std::uint64_t allocations = 0;
  const int runs = quick ? 200 : 2000;
  for (std::vector<double> *times : {&ours, &plain, &robust}) {
    times->reserve(static_cast<std::size_t>(runs)); // reserved before the count of the fits' allocations
  }
  int right = 0;
  for (int run = 0; run < runs; ++run) {
    const auto T = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
    std::vector<PointPair> pairs;
    std::vector<Eigen::Vector3d> source;
    std::vector<Eigen::Vector3d> target;
    for (int i = 0; i < 8; ++i) {
      PointPair pair;
      pair.source_mm = test::normal_vector(rng, 60.0);
      pair.target_covariance = test::random_anisotropic(rng, 0.3, 0.9);
      pair.target_mm = T * pair.source_mm + test::draw(rng, pair.target_covariance);
      pairs.push_back(pair);
      source.push_back(pair.source_mm);
      target.push_back(pair.target_mm);
    }
    const test::AllocationScope scope;
    PairedFit fit;
    ours.push_back(1e3 * milliseconds([&] { fit = fit_paired(pairs); }));
    std::optional<PairedPose> rigid;
    plain.push_back(1e3 * milliseconds([&] { rigid = fit_rigid(source, target); }));
    pairs[3].target_mm += 10.0 * test::normal_vector(rng, 1.0).normalized();
    RobustFit with_outlier;
    robust.push_back(1e3 * milliseconds([&] { with_outlier = fit_paired_robust(pairs); }));
    allocations += scope.count();
    right += with_outlier.found && with_outlier.outliers == 1 && !with_outlier.inlier[3] ? 1 : 0;
  }
  report.add(with_peer(at_most("points.paired_8_anisotropic.median", percentile(ours, 0.5), "us", 20.0),
                       percentile(plain, 0.5), "least squares"));
  report.add(figure("points.robust_8_one_outlier.median", percentile(robust, 0.5), "us"));
  report.add(at_least("points.robust_outlier_named", 100.0 * right / runs, "%", 95.0));
  if (test::AllocationScope::available()) {
    report.add(at_most("points.allocations", static_cast<double>(allocations), "", 0.0));
  }
}

// Coverage: how often the true error at a target 80 mm away lies inside the predicted 95 % ellipsoid.
void paired_coverage(Report &report, int runs) {
  for (const auto &[name, depth_mm] : {std::pair("isotropic", 0.3), std::pair("anisotropic", 0.9)}) {
    std::mt19937 rng(kStudySeed);
    int inside = 0;
    for (int run = 0; run < runs; ++run) {
      const auto T = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
      std::vector<PointPair> pairs(8);
      for (PointPair &pair : pairs) {
        pair.source_mm = test::normal_vector(rng, 60.0);
        pair.target_covariance = test::random_anisotropic(rng, 0.3, depth_mm);
        pair.target_mm = T * pair.source_mm + test::draw(rng, pair.target_covariance);
      }
      const Eigen::Vector3d target = 80.0 * test::normal_vector(rng, 1.0).normalized();
      const PairedFit fit = fit_paired(pairs);
      const Eigen::Vector3d error = fit.T_target_source * target - T * target;
      const Matrix3d predicted = uncertainty::tre_covariance(fit.covariance, T * target);
      inside +=
          uncertainty::mahalanobis_squared(predicted, error) <= uncertainty::chi_square_upper_quantile(0.05, 3) ? 1 : 0;
    }
    const std::string label = std::string("points.coverage.") + name;
    report.add(at_least(label, 100.0 * inside / runs, "%", 93.0));
    report.add(at_most(label + ".not_more", 100.0 * inside / runs, "%", 97.0));
  }
}

} // namespace

void point_figures(Report &report, const RegistrationBenchOptions &options) {
  paired_figures(report, options.quick);
  paired_coverage(report, options.quick ? 200 : 2000);
}

} // namespace bregma::bench
