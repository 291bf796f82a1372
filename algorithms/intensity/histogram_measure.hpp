// Mutual information and normalised mutual information of one or several features. Internal to the room.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "algorithms/intensity/pair_sampler.hpp"
#include "algorithms/intensity/similarity_measure.hpp"

namespace bregma::intensity {

class HistogramMeasure final : public SimilarityMeasure {
public:
  // A feature of both images, or any label of the reference's voxels with a feature of the floating image.
  struct Channel {
    std::vector<float> reference; // on the reference's grid: grey values
    std::vector<float> floating;  // on the floating image's grid
    double weight = 1.0;
    int rows = 0; // 0: `reference` is scaled to the bins; otherwise it holds whole numbers from 0 to rows - 1
  };
  HistogramMeasure(const Volume &reference, const Volume &floating, std::vector<Channel> channels, bool normalised,
                   const MeasureOptions &options, parallel::Team &team);

  double value(const Eigen::Matrix4d &T_floating_reference) noexcept override;
  [[nodiscard]] bool has_gradient() const noexcept override;
  double value_and_gradient(const Eigen::Matrix4d &T_floating_reference, AffineGradient &gradient) noexcept override;
  [[nodiscard]] std::size_t samples() const noexcept override { return sampler_.size(); }

  // For deformations: whose samples may be moved, and the derivative with respect to the index of each sample in the
  // floating image, per axis into lists of sampler().padded().
  [[nodiscard]] PairSampler &sampler() { return sampler_; }
  double value_and_forces(const Eigen::Matrix4d &T_floating_reference, const std::array<float *, 3> &forces) noexcept;

  // Of the last evaluation.
  [[nodiscard]] const Entropies &entropies(std::size_t channel) const {
    return channels_[channel].parts[0].entropies();
  }

private:
  struct Prepared {
    std::vector<std::uint16_t> row;
    std::vector<float> floating; // coordinates of bins
    std::vector<float> column, dx, dy, dz;
    float outside = 0.0F;
    double weight = 1.0;
    std::vector<JointHistogram> parts; // the first receives the sum
  };
  void fill(Prepared &channel, std::size_t part, bool with_slopes) noexcept;
  double evaluate(const Eigen::Matrix4d &T_floating_reference, bool with_slopes) noexcept;
  // Of one part: the derivative with respect to the map between indices.
  [[nodiscard]] Affine34 gradient_of(Prepared &channel, const PairSampler::Part &part) const noexcept;

  PairSampler sampler_;
  Interpolation interpolation_;
  bool normalised_;
  double min_overlap_;
  parallel::Team &team_;
  std::vector<Prepared> channels_;
  std::vector<Affine34> part_gradients_;
};

// Of the measures that are sums of (normalised) mutual information: MI, NMI, GMI, AMI and MF-MI. Throws as
// make_measure(), and for other measures.
[[nodiscard]] std::unique_ptr<HistogramMeasure> make_histogram_measure(Measure measure, const Volume &reference,
                                                                       const Volume &floating,
                                                                       const MeasureOptions &options,
                                                                       parallel::Team &team);

} // namespace bregma::intensity
