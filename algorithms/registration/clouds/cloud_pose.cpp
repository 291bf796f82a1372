#include "algorithms/registration/clouds/cloud_pose.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <thread>

#include <Eigen/Geometry>

#include "algorithms/registration/surface/pose_search.hpp"

namespace bregma::registration {

using geometry::Points3;

namespace {

constexpr int kMiddleCandidates = 8;
constexpr double kCoarseSigma = 0.3; // relative to the target's size: below it a start keeps its rotation

// The points in a random order, so that every prefix is a fair sample.
Points3 shuffled(const Points3 &points, int count, unsigned seed) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>(points.cols()));
  std::iota(order.begin(), order.end(), 0);
  std::mt19937 rng(seed);
  const auto wanted = std::min(static_cast<std::size_t>(count), order.size());
  for (std::size_t i = 0; i < wanted; ++i) {
    std::swap(order[i], order[i + rng() % (order.size() - i)]);
  }
  Points3 out(3, static_cast<Eigen::Index>(wanted));
  for (std::size_t i = 0; i < wanted; ++i) {
    out.col(static_cast<Eigen::Index>(i)) = points.col(order[i]);
  }
  return out;
}

Points3 first(const Points3 &points, int count) {
  return points.leftCols(std::min<Eigen::Index>(count, points.cols()));
}

double turn(const CpdResult<3> &a, const CpdResult<3> &b) {
  return Eigen::AngleAxisd(Eigen::Matrix3d(a.rotation.transpose() * b.rotation)).angle();
}

// The most likely first, without those that are rotated by less than distinct_rad from a more likely one.
std::vector<CpdResult<3>> distinct(std::vector<CpdResult<3>> all, double distinct_rad, std::size_t count) {
  std::erase_if(all, [](const CpdResult<3> &one) { return !one.has_estimate(); });
  std::stable_sort(all.begin(), all.end(),
                   [](const CpdResult<3> &a, const CpdResult<3> &b) { return a.log_likelihood > b.log_likelihood; });
  std::vector<CpdResult<3>> out;
  for (const CpdResult<3> &one : all) {
    const bool seen =
        std::any_of(out.begin(), out.end(), [&](const CpdResult<3> &other) { return turn(one, other) < distinct_rad; });
    if (!seen && out.size() < count) {
      out.push_back(one);
    }
  }
  return out;
}

} // namespace

CloudPose find_cloud_pose(const Points3 &source_mm, const Points3 &target_mm, const CloudPoseOptions &options) {
  CloudPose out;
  if (source_mm.cols() < 4 || target_mm.cols() < 4) {
    return out;
  }
  if (!source_mm.allFinite() || !target_mm.allFinite()) {
    out.best.outcome = CpdOutcome::kNotFinite;
    return out;
  }
  const Points3 source = shuffled(source_mm, options.fine_points, options.seed);
  const Points3 target = shuffled(target_mm, options.fine_points, options.seed + 1);
  const Eigen::Vector3d source_centre = source.rowwise().mean();
  const Eigen::Vector3d target_centre = target.rowwise().mean();
  const double size = std::sqrt((target.colwise() - target_centre).squaredNorm() / static_cast<double>(target.cols()));

  CpdOptions coarse;
  coarse.outlier_weight = options.outlier_weight;
  coarse.start_sigma_mm = kCoarseSigma * size;
  coarse.tolerance = 1e-3;
  coarse.max_iterations = 40;
  const std::vector<Eigen::Quaterniond> rotations = spread_rotations(options.starts);
  std::vector<CpdResult<3>> candidates(rotations.size());
  const Points3 coarse_source = first(source, options.coarse_points);
  const Points3 coarse_target = first(target, options.coarse_points);
  const auto threads = static_cast<std::size_t>(std::max(options.threads, 1));
  const auto run = [&](std::size_t index) {
    for (std::size_t i = index; i < rotations.size(); i += threads) {
      const CpdTransform<3> start{rotations[i].toRotationMatrix(), target_centre - rotations[i] * source_centre};
      candidates[i] = register_cpd<3>(coarse_source, coarse_target, coarse, &start);
    }
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t i = 1; i < threads; ++i) {
      others.emplace_back(run, i);
    }
    run(0);
  }

  std::vector<CpdResult<3>> refined;
  CpdOptions middle = coarse;
  middle.threads = options.threads;
  middle.tolerance = 1e-4;
  middle.max_iterations = 60;
  for (const CpdResult<3> &one : distinct(std::move(candidates), options.distinct_rad, kMiddleCandidates)) {
    middle.start_sigma_mm = one.sigma_mm;
    refined.push_back(register_cpd<3>(first(source, options.middle_points), first(target, options.middle_points),
                                      middle, &one.transform));
  }
  const std::vector<CpdResult<3>> best = distinct(std::move(refined), options.distinct_rad, 2);
  if (best.empty()) {
    out.best.outcome = CpdOutcome::kNoOverlap;
    return out;
  }
  out.middle_log_likelihood = best[0].log_likelihood;
  if (best.size() > 1) {
    out.runner_up = best[1];
  }
  CpdOptions fine = middle;
  fine.start_sigma_mm = best[0].sigma_mm;
  fine.tolerance = 1e-5;
  fine.max_iterations = 200;
  out.best = register_cpd<3>(source, target, fine, &best[0].transform);
  return out;
}

} // namespace bregma::registration
