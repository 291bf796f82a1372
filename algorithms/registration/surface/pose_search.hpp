// The search of GlobalRegistration: a short list of distinct poses from all rotations. See global_surface.hpp.
#pragma once

#include <span>
#include <vector>

#include "algorithms/registration/surface/plane_step.hpp"

namespace bregma::registration {

// The best-fitting sphere: algebraic least squares, with minimum norm where the points do not determine it.
struct FittedSphere {
  Vector3d centre_mm = Vector3d::Zero();
  double radius_mm = 0.0;
};
[[nodiscard]] FittedSphere fit_sphere(std::span<const Vector3d> points_mm) noexcept;

// The centroid and the covariance of points.
struct Spread {
  Vector3d middle_mm = Vector3d::Zero();
  Matrix3d covariance = Matrix3d::Zero();
};
[[nodiscard]] Spread spread_of(std::span<const Vector3d> points_mm) noexcept;

// n rotations spread evenly over SO(3): super-Fibonacci spirals [Alexa 2022, algorithm 1].
[[nodiscard]] std::vector<Eigen::Quaterniond> spread_rotations(int n);

struct PoseCandidate {
  PairedPose T_target_source;
  double cost = 0.0;
  Vector3d middle_mm = Vector3d::Zero(); // centroid of the mapped samples; set when the list is thinned
};

class PoseSearch {
public:
  PoseSearch(const surface::SurfaceField &field, int rotations, int threads);

  // The best distinct poses, the best first; at least one. sigma_mm: the error of a sample. Two poses are distinct when
  // they differ by distinct_mm somewhere on the samples.
  [[nodiscard]] std::span<const PoseCandidate> run(std::span<const Vector3d> samples_mm, double sigma_mm,
                                                   double distinct_mm);

private:
  void start_poses(std::span<const Vector3d> samples_mm);
  void descend(std::span<PoseCandidate> candidates, std::size_t samples, std::span<const double> reaches_mm) const;
  // Sorts by cost and keeps the best distinct poses, at most max_count.
  void thin(std::size_t max_count, double distinct_mm);

  const surface::SurfaceField *field_;
  int threads_;
  std::vector<Eigen::Quaterniond> rotations_;
  SampleLanes samples_; // in an order whose beginnings are spread over all samples
  std::size_t count_ = 0;
  Spread spread_;
  std::vector<PoseCandidate> candidates_;
  std::vector<PoseCandidate> kept_;
};

// RMS distance between the points mapped by two poses, the measure of distinct poses. Exact.
[[nodiscard]] double pose_distance_mm(const PairedPose &a, const PairedPose &b, const Spread &points) noexcept;

} // namespace bregma::registration
