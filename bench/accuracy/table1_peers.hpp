// The methods that [NeuroGuide] used or tried, on the paper's own terms: samples onto a cloud of a face.
//
// - Point-to-point least-squares ICP [Besl 1992] with a tolerance of 1e-16.
// - The cost of Go-ICP [Yang 2016], the sum of squared distances to the nearest point, read from a distance grid, under
//   simulated annealing and under a genetic algorithm.
// - Go-ICP itself: branch and bound over rotations, with a nested one over translations, and ICP at every improvement.
//   Debian has no package of it; this is an implementation for the benchmark only, with a limit of time.
//
// One thread at a time.
#pragma once

#include <random>
#include <span>
#include <vector>

#include "algorithms/surface/cloud_model.hpp"
#include "bench/accuracy/registration_head.hpp"

namespace bregma::bench {

// Where a pose is searched: rotations by at most `angle_rad` from a middle one about the samples' centroid, which is
// placed on the cloud's centroid and moved by at most `reach_mm` per axis.
struct SearchRegion {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  double angle_rad = 0.0;
  double reach_mm = 40.0;
};

struct PeerOptions {
  int icp_iterations = 1000;
  int evaluations = 20000;      // of annealing and of the genetic algorithm
  double go_icp_seconds = 5.0;  // of CPU time; afterwards the best pose so far counts, without a bound
  double go_icp_gap_mm2 = 10.0; // of the mean square: the default of Go-ICP for a cloud of 100 mm radius
};

struct GoIcpResult {
  PairedPose T_target_source;
  bool bounded = false; // no pose of the region is better by more than the gap
};

class FacePeers {
public:
  FacePeers(std::vector<Vector3d> cloud_mm, const PeerOptions &options);

  // The middle of a region, as a pose.
  [[nodiscard]] PairedPose start(std::span<const Vector3d> samples_mm, const SearchRegion &region) const;
  [[nodiscard]] PairedPose icp(std::span<const Vector3d> samples_mm, PairedPose start) const;
  [[nodiscard]] PairedPose anneal(std::span<const Vector3d> samples_mm, const SearchRegion &region,
                                  std::mt19937 &rng) const;
  [[nodiscard]] PairedPose evolve(std::span<const Vector3d> samples_mm, const SearchRegion &region,
                                  std::mt19937 &rng) const;
  [[nodiscard]] GoIcpResult go_icp(std::span<const Vector3d> samples_mm, const SearchRegion &region) const;

private:
  [[nodiscard]] double distance_mm(const Vector3d &p) const; // from the grid
  [[nodiscard]] double mean_square_mm2(std::span<const Vector3d> samples_mm, const PairedPose &pose) const;
  struct Branching;

  std::vector<Vector3d> points_;
  surface::CloudModel cloud_;
  PeerOptions options_;
  Vector3d centroid_;
  Vector3d grid_low_;
  Eigen::Vector3i grid_size_;
  std::vector<float> grid_;
};

} // namespace bregma::bench
