#include "algorithms/registration/surface/pose_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <thread>

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include "algorithms/registration/twist.hpp"

namespace bregma::registration {

using Eigen::Quaterniond;
using Eigen::Vector3f;

namespace {

constexpr double kFlatRadius_mm = 160.0; // a flatter bulge does not determine the outer side
constexpr double kFlatShare =
    1e-3; // relative singular value below which a direction of the sphere's centre is undetermined
constexpr double kRayStart_mm = 250.0;
constexpr int kRaySteps = 24;
constexpr double kDamping = 1e-3;

struct Stage {
  std::size_t samples;
  std::array<double, 8> reaches_mm; // reach of each step's loss; 0: no further step
  std::size_t keep;
  double distinct_mm;
};
// Wide at first, so that a start 15 degrees off converges; the last reach also ranks the poses.
constexpr std::array<Stage, 3> kStages{{{32, {40, 25, 15, 10, 0}, 400, 4.0},
                                        {64, {20, 12, 8, 8, 6, 6, 6, 6}, 60, 6.0},
                                        {200, {8, 6, 5, 4, 4, 4, 4, 4}, 12, 0.0}}};

// Intersection of a ray from outside with the surface, by steps of the distance itself (sphere tracing [Hart 1996]).
double ray_radius(const surface::SurfaceField &field, const Vector3d &centre, const Vector3d &direction) {
  double at = kRayStart_mm;
  for (int i = 0; i < kRaySteps; ++i) {
    const Vector3f p = (centre + at * direction).cast<float>();
    const surface::SurfaceField::Plane &plane = field.plane(p);
    const double distance = static_cast<double>(plane.normal.dot(p) + plane.offset);
    if (distance < 1.0) {
      break;
    }
    at -= distance;
  }
  return std::max(at, 0.0);
}

} // namespace

Spread spread_of(std::span<const Vector3d> points_mm) noexcept {
  Spread out;
  const auto n = static_cast<double>(points_mm.size());
  for (const Vector3d &p : points_mm) {
    out.middle_mm += p / n;
  }
  for (const Vector3d &p : points_mm) {
    out.covariance += (p - out.middle_mm) * (p - out.middle_mm).transpose() / n;
  }
  return out;
}

FittedSphere fit_sphere(std::span<const Vector3d> points_mm) noexcept {
  // |q|^2 = 2 q.c + k about the centroid.
  const auto [middle, covariance] = spread_of(points_mm);
  const double mean_squared = covariance.trace();
  Vector3d b = Vector3d::Zero();
  for (const Vector3d &p : points_mm) {
    const Vector3d q = p - middle;
    b += 0.5 * (q.squaredNorm() - mean_squared) * q / static_cast<double>(points_mm.size());
  }
  Eigen::JacobiSVD<Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  svd.setThreshold(kFlatShare);
  const Vector3d c = svd.solve(b);
  return {middle + c, std::sqrt(mean_squared + c.squaredNorm())};
}

std::vector<Quaterniond> spread_rotations(int n) {
  constexpr double kPsi = 1.533751168755204288118041; // positive root of x^4 = x + 4
  std::vector<Quaterniond> out;
  for (int i = 0; i < n; ++i) {
    const double s = i + 0.5;
    const double share = s / n;
    const double alpha = 2.0 * std::numbers::pi * s / std::numbers::sqrt2;
    const double beta = 2.0 * std::numbers::pi * s / kPsi;
    out.emplace_back(std::sqrt(1.0 - share) * std::cos(beta), std::sqrt(share) * std::sin(alpha),
                     std::sqrt(share) * std::cos(alpha), std::sqrt(1.0 - share) * std::sin(beta));
  }
  return out;
}

// |Ta p - Tb p|^2 = |D q + d|^2 with q = p - centroid, D = Ra - Rb, d the difference of the mapped centroids; q has
// mean zero.
double pose_distance_mm(const PairedPose &a, const PairedPose &b, const Spread &points) noexcept {
  const Matrix3d D = a.rotation_matrix() - b.rotation_matrix();
  return std::sqrt((a * points.middle_mm - b * points.middle_mm).squaredNorm() +
                   (D * points.covariance * D.transpose()).trace());
}

PoseSearch::PoseSearch(const surface::SurfaceField &field, int rotations, int threads)
    : field_(&field), threads_(threads), rotations_(spread_rotations(rotations)) {
  candidates_.reserve(2 * rotations_.size());
  kept_.reserve(candidates_.capacity());
}

void PoseSearch::start_poses(std::span<const Vector3d> samples_mm) {
  const FittedSphere sphere = fit_sphere(samples_mm);
  Vector3d outward = spread_.middle_mm - sphere.centre_mm;
  const double sagitta = std::clamp(sphere.radius_mm - outward.norm(), 0.0, 120.0);
  outward = outward.norm() > 1e-6 ? Vector3d(outward.normalized()) : Vector3d(Vector3d::UnitZ());
  const bool flat = sphere.radius_mm > kFlatRadius_mm;
  const Vector3d head = field_->surface().centre_mm();
  candidates_.clear();
  for (const Quaterniond &R : rotations_) {
    for (const double side : {1.0, -1.0}) {
      const Vector3d direction = side * (R * outward);
      const double radius = ray_radius(*field_, head, direction) - sagitta;
      const Vector3d translation = head + radius * direction - R * spread_.middle_mm;
      candidates_.push_back({PairedPose(R, translation), 0.0, Vector3d::Zero()});
      if (!flat) {
        break;
      }
    }
  }
}

void PoseSearch::descend(std::span<PoseCandidate> candidates, std::size_t samples,
                         std::span<const double> reaches_mm) const {
  const std::size_t few = std::min(samples, count_);
  const auto work = [&](std::size_t first, std::size_t step) {
    for (std::size_t i = first; i < candidates.size(); i += step) {
      PairedPose &T = candidates[i].T_target_source;
      double last_reach = 1.0;
      for (const double reach : reaches_mm) {
        if (reach == 0.0) {
          break;
        }
        const Vector3d centre = T * spread_.middle_mm;
        const PlaneStep at = plane_step(*field_, samples_, few, T, centre, reach);
        T = moved_about(centre, solve_damped(at.normal, at.gradient, kDamping, kStepLimit_mm), T);
        last_reach = reach;
      }
      candidates[i].cost = plane_cost(*field_, samples_, few, T, last_reach);
    }
  };
  const auto threads = static_cast<std::size_t>(threads_);
  std::vector<std::thread> others;
  for (std::size_t i = 1; i < threads; ++i) {
    others.emplace_back(work, i, threads);
  }
  work(0, threads);
  for (std::thread &other : others) {
    other.join();
  }
}

void PoseSearch::thin(std::size_t max_count, double distinct_mm) {
  std::stable_sort(candidates_.begin(), candidates_.end(),
                   [](const PoseCandidate &a, const PoseCandidate &b) { return a.cost < b.cost; });
  kept_.clear();
  // A rotation moves the points at least as much as their two smaller spreads: this separates most pairs.
  const double least_mm2 = 4.0 * (spread_.covariance.trace() - spread_.covariance.operatorNorm());
  const double limit = distinct_mm * distinct_mm;
  for (const PoseCandidate &candidate : candidates_) {
    const PairedPose &T = candidate.T_target_source;
    const Vector3d middle = T * spread_.middle_mm;
    const bool distinct = std::none_of(kept_.begin(), kept_.end(), [&](const PoseCandidate &other) {
      const double cosine = T.rotation().dot(other.T_target_source.rotation());
      return (middle - other.middle_mm).squaredNorm() + (1.0 - cosine * cosine) * least_mm2 < limit &&
             pose_distance_mm(T, other.T_target_source, spread_) < distinct_mm;
    });
    if (distinct) {
      kept_.push_back(candidate);
      kept_.back().middle_mm = middle;
      if (kept_.size() == max_count) {
        break;
      }
    }
  }
  candidates_.swap(kept_);
}

std::span<const PoseCandidate> PoseSearch::run(std::span<const Vector3d> samples_mm, double sigma_mm,
                                               double distinct_mm) {
  const std::size_t n = samples_mm.size();
  spread_ = spread_of(samples_mm);
  // In the order of a golden-ratio sequence, every prefix of which is spread over the whole trace.
  count_ = n;
  if (samples_.capacity() < n) {
    samples_.reserve(n);
  }
  std::vector<std::pair<double, std::size_t>> order(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double walk = std::numbers::phi * static_cast<double>(i);
    order[i] = {walk - std::floor(walk), i};
  }
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < n; ++i) {
    samples_.set(i, samples_mm[order[i].second]);
  }

  start_poses(samples_mm);
  for (const Stage &stage : kStages) {
    std::array<double, 8> reaches = stage.reaches_mm;
    for (double &reach : reaches) {
      reach = reach > 0.0 ? std::max(reach, 3.0 * sigma_mm) : 0.0;
    }
    descend(candidates_, stage.samples, reaches);
    thin(stage.keep, stage.distinct_mm > 0.0 ? stage.distinct_mm : distinct_mm);
  }
  return candidates_;
}

} // namespace bregma::registration
