// The search of GlobalRegistration: from every rotation to a short list of distinct poses. See global_surface.hpp.
#pragma once

#include <span>
#include <vector>

#include "algorithms/registration/surface/plane_step.hpp"

namespace bregma::registration {

// The sphere that fits points best: algebraic least squares, of least norm where the points leave it open.
struct FittedSphere {
  Vector3d centre_mm = Vector3d::Zero();
  double radius_mm = 0.0;
};
[[nodiscard]] FittedSphere fit_sphere(std::span<const Vector3d> points_mm) noexcept;

// The middle and the covariance of points.
struct Spread {
  Vector3d middle_mm = Vector3d::Zero();
  Matrix3d covariance = Matrix3d::Zero();
};
[[nodiscard]] Spread spread_of(std::span<const Vector3d> points_mm) noexcept;

// n rotations spread evenly over SO(3): super-Fibonacci spirals (Alexa 2022, algorithm 1).
[[nodiscard]] std::vector<Eigen::Quaterniond> spread_rotations(int n);

struct PoseCandidate {
  PairedPose T_target_source;
  double cost = 0.0;
  Vector3d middle_mm = Vector3d::Zero(); // of the samples, mapped; once the list is thinned
};

class PoseSearch {
public:
  PoseSearch(const surface::SurfaceField &field, int rotations, int threads);

  // The best distinct poses, the best first; at least one. sigma_mm: the error of a sample. Spread of the samples
  // decides when two poses are distinct: somewhere on the samples they differ by distinct_mm.
  [[nodiscard]] std::span<const PoseCandidate> run(std::span<const Vector3d> samples_mm, double sigma_mm,
                                                   double distinct_mm);

private:
  void start_poses(std::span<const Vector3d> samples_mm);
  void descend(std::span<PoseCandidate> candidates, std::size_t samples, std::span<const double> reaches_mm) const;
  // Sorts by cost and keeps the best that are distinct, at most most.
  void thin(std::size_t max_count, double distinct_mm);

  const surface::SurfaceField *field_;
  int threads_;
  std::vector<Eigen::Quaterniond> rotations_;
  SampleLanes samples_; // any first ones of them are spread over all
  std::size_t count_ = 0;
  Spread spread_;
  std::vector<PoseCandidate> candidates_;
  std::vector<PoseCandidate> kept_;
};

// RMS distance between the places of points under two poses: what sets two poses apart. Exact.
[[nodiscard]] double pose_distance_mm(const PairedPose &a, const PairedPose &b, const Spread &points) noexcept;

} // namespace bregma::registration
