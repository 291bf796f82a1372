// Figures of coherent point drift, compared with direct sums, a published fixture and Go-ICP's bunny.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>
#include <vector>

#include <Eigen/Geometry>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/clouds/cloud_pose.hpp"
#include "algorithms/registration/clouds/gauss_kernel.hpp"
#include "algorithms/registration/clouds/gauss_sums.hpp"
#include "bench/accuracy/registration_head.hpp"
#include "bench/accuracy/registration_parts.hpp"
#include "bench/accuracy/registration_study.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/algorithms/tables.hpp"

namespace bregma::bench {

namespace {

using namespace registration;
using geometry::Points2;
using geometry::Points3;

double degrees_between(const Eigen::Matrix3d &a, const Eigen::Matrix3d &b) {
  return Eigen::AngleAxisd(Eigen::Matrix3d(a.transpose() * b)).angle() / geometry::kRadiansPerDegree;
}

// The E-step as in the paper: in double precision, one exponential per pair, with the full matrix stored.
double naive_e_step_ms(const Points3 &x, const Points3 &y, double sigma, double c) {
  return milliseconds([&] {
    Eigen::MatrixXd P(y.cols(), x.cols());
    for (Eigen::Index n = 0; n < x.cols(); ++n) {
      for (Eigen::Index m = 0; m < y.cols(); ++m) {
        P(m, n) = std::exp(-(x.col(n) - y.col(m)).squaredNorm() / (2.0 * sigma * sigma));
      }
      P.col(n) /= P.col(n).sum() + c;
    }
    const Eigen::VectorXd weight = P.rowwise().sum();
    const Eigen::MatrixXd px = P * x.transpose();
    if (!(weight.sum() + px.sum() < 1e300)) {
      throw std::runtime_error("the naive E-step is not finite");
    }
  });
}

void cpd_figures(Report &report, const std::string &case_folder, bool quick) {
  const Head head = load_head(case_folder);
  std::mt19937 rng(kStudySeed);
  report.note("CPD: vertices of the scalp, 20 % replaced by outliers, 30 degrees, noise 0.5 mm, two threads, sums by " +
              std::string(gauss_kernels().front().name) + "; seed " + std::to_string(kStudySeed));
  for (const auto &[count, limit_ms] : {std::pair(1000, 150.0), std::pair(3000, 1000.0)}) {
    std::vector<double> times;
    std::vector<double> errors;
    std::vector<double> naive;
    for (int run = 0; run < (quick ? 3 : 20); ++run) {
      Points3 source(3, count);
      std::vector<Eigen::Vector3d> points;
      std::sample(head.mesh.vertices_mm.begin(), head.mesh.vertices_mm.end(), std::back_inserter(points), count, rng);
      for (Eigen::Index i = 0; i < count; ++i) {
        source.col(i) = points[static_cast<std::size_t>(i)];
      }
      const Eigen::Matrix3d R =
          Eigen::AngleAxisd(30.0 * geometry::kRadiansPerDegree, test::normal_vector(rng, 1.0).normalized())
              .toRotationMatrix();
      Points3 target = R * source;
      const Eigen::Vector3d middle = target.rowwise().mean();
      std::uniform_real_distribution<double> box(-120.0, 120.0);
      for (Eigen::Index i = 0; i < count; ++i) {
        target.col(i) = i % 5 == 0 ? Eigen::Vector3d(middle + Eigen::Vector3d(box(rng), box(rng), box(rng)))
                                   : Eigen::Vector3d(target.col(i) + test::normal_vector(rng, 0.5));
      }
      CpdOptions options;
      options.outlier_weight = 0.2;
      options.threads = 2;
      CpdResult<3> found;
      times.push_back(milliseconds([&] { found = register_cpd<3>(source, target, options); }));
      errors.push_back(found.has_estimate() ? degrees_between(found.rotation, R) : 180.0);
      if (run == 0) {
        naive.push_back(found.iterations * naive_e_step_ms(target / 100.0, source / 100.0, 0.3, 1.0));
      }
    }
    const std::string name = "cpd." + std::to_string(count);
    report.add(with_peer(at_most(name + ".median", percentile(times, 0.5), "ms", limit_ms), naive[0], "naive E-steps"));
    report.add(figure(name + ".rotation_error.worst", percentile(errors, 1.0), "deg"));
  }
}

void fixture_figures(Report &report) {
  const auto folder = kShared / "clouds/cpd";
  if (!is_present(report, folder)) {
    return;
  }
  const Points2 fish = test::read_points<2>(folder / "fish.csv");
  const Points2 distorted = test::read_points<2>(folder / "fish_distorted.csv");
  const auto expected = test::read_points<1>(folder / "fish_correspondence.csv");
  const auto found = correspondences<2>(distorted, fish, 1.0, paper_outlier_constant<2>(1.0, 0.1, 91, 91));
  int matched = 0;
  for (Eigen::Index m = 0; m < expected.cols(); ++m) {
    matched += found.of_source[static_cast<std::size_t>(m)].index == static_cast<int>(expected(0, m)) ? 1 : 0;
  }
  report.add(at_least("cpd.fish_correspondences_matched", matched, "of 91", 91.0));
}

Points3 read_counted(const std::filesystem::path &file) {
  std::ifstream in(file);
  Eigen::Index count = 0;
  in >> count;
  Points3 out(3, count);
  for (double &v : out.reshaped()) {
    in >> v;
  }
  return out;
}

void bunny_figures(Report &report) {
  const auto folder = kShared / "clouds/bunny";
  if (!is_present(report, folder)) {
    return;
  }
  const Points3 data = read_counted(folder / "data_bunny.txt");
  const Points3 model = read_counted(folder / "model_bunny.txt");
  std::ifstream in(folder / "output.txt");
  double their_seconds = 0.0;
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> theirs;
  in >> their_seconds;
  for (double &v : theirs.reshaped<Eigen::RowMajor>()) {
    in >> v;
  }
  // The model is complete and the data covers a part of it, so the model is the source.
  std::vector<double> times;
  std::vector<double> errors;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    CloudPoseOptions options;
    options.threads = 2;
    options.seed = seed;
    CloudPose pose;
    times.push_back(1e-3 * milliseconds([&] { pose = find_cloud_pose(model, data, options); }));
    errors.push_back(degrees_between(pose.best.rotation.transpose(), theirs));
  }
  report.add(with_peer(at_most("bunny.time.median", percentile(times, 0.5), "s", 0.1 * their_seconds), their_seconds,
                       "Go-ICP, as published"));
  report.add(at_most("bunny.rotation_to_theirs.worst", percentile(errors, 1.0), "deg", 0.5));
}

} // namespace

void cloud_figures(Report &report, const RegistrationBenchOptions &options) {
  cpd_figures(report, options.case_folder, options.quick);
  fixture_figures(report);
  bunny_figures(report);
}

} // namespace bregma::bench
