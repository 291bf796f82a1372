// Where a measure compares two images: the same places of the reference at every evaluation.
//
// Internal to the room. Everything is allocated by the constructor. set_pose() is for one thread, sample() for several,
// on different parts.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "algorithms/intensity/features.hpp"
#include "algorithms/intensity/sample_kernel.hpp"

namespace bregma::intensity {

using Affine34 = Eigen::Matrix<double, 3, 4>;

class PairSampler {
public:
  // All voxels of the reference with a value; where there are more than max_samples (0: no limit), one at random of
  // each of as many stretches of them, moved within its voxel so that the grids of the two images do not coincide.
  PairSampler(const Volume &reference, const Volume &floating, std::size_t max_samples, std::uint64_t seed);
  // All voxels, also those without a value, in the order of the grid: for measures that look at neighbours.
  PairSampler(const Volume &reference, const Volume &floating);

  [[nodiscard]] std::size_t size() const { return count_; }
  [[nodiscard]] std::size_t padded() const { return x_.size(); }
  // Samples of a part, in memory's order. Their number depends on the samples only, so that sums do not depend on the
  // number of threads.
  struct Part {
    std::size_t first = 0;
    std::size_t count = 0;   // with padding, whose values are `outside`
    std::size_t samples = 0; // without
  };
  [[nodiscard]] const std::vector<Part> &parts() const { return parts_; }

  // An image on the reference's grid at the samples.
  [[nodiscard]] std::vector<float> of_reference(const std::vector<float> &values) const;
  // Index of the samples in the reference's grid, along an axis.
  [[nodiscard]] const float *coordinate(std::size_t axis) const {
    return (axis == 0 ? x_ : axis == 1 ? y_ : z_).data();
  }

  void set_pose(const Eigen::Matrix4d &T_floating_reference) noexcept;
  // Under a deformation: the samples are mapped from these indices of the reference's grid instead of their own. Made
  // by the first call, with each sample at its own place.
  [[nodiscard]] std::array<std::vector<float>, 3> &moved();
  // An image on the floating image's grid at the samples of a part. The lists have padded() entries.
  void sample(const Part &part, const std::vector<float> &values, bool nearest, float outside,
              const SampledValues &out) const noexcept;
  // The eight voxels around a sample with their weights; false outside.
  struct Neighbours {
    std::array<std::size_t, 8> offset;
    std::array<float, 8> weight;
  };
  [[nodiscard]] bool neighbours(std::size_t sample, Neighbours &out) const noexcept;

  // Derivative with respect to the map between indices to that with respect to T_floating_reference in mm.
  [[nodiscard]] Affine34 to_mm(const Affine34 &by_index) const noexcept;
  // Linear part of the current pose.
  [[nodiscard]] const Eigen::Matrix3f &linear_part() const { return linear_; }
  // Volume of the floating image, where it has values, as a fraction of that of the samples; at most 1.
  [[nodiscard]] double reachable() const { return reachable_; }

private:
  void finish();

  image::Grid<3> reference_, floating_;
  Eigen::Matrix4d index_from_floating_;
  std::vector<float> x_, y_, z_;
  std::array<std::vector<float>, 3> moved_; // empty: not deformed
  std::size_t count_ = 0;
  std::vector<Part> parts_;
  std::array<float, 12> T_{};
  Eigen::Matrix3f linear_ = Eigen::Matrix3f::Identity();
  double reachable_ = 1.0;
  SampleKernels kernels_;
};

} // namespace bregma::intensity
