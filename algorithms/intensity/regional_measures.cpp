// Conditional mutual information and spatially encoded mutual information: histograms of overlapping regions.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algorithms/intensity/pair_sampler.hpp"
#include "algorithms/intensity/variants.hpp"

namespace bregma::intensity {

namespace {

constexpr int kNodesPerAxis = 4;
constexpr int kMaxRegionalBins = 32; // the regions share the samples
constexpr float kLambda = 0.5F;      // SEMI: fraction of the local histogram in the mixture
constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();

enum class Kind { kConditional, kSpatiallyEncoded };

class RegionalMeasure final : public SimilarityMeasure {
public:
  RegionalMeasure(Kind kind, const Volume &reference, const Volume &floating, const MeasureOptions &options,
                  parallel::Team &team)
      : kind_(kind), bins_(std::min(options.bins, kMaxRegionalBins)),
        nearest_(options.interpolation == Interpolation::kNearest),
        outside_(options.outside == Outside::kDark ? 0.0F : kNowhere), min_overlap_(options.min_overlap), team_(team),
        sampler_(reference, floating, options.max_samples, options.seed), mapped_(sampler_.padded()) {
    const GreyRange of_floating = grey_range(floating.voxels, options.tail);
    const GreyRange of_reference = grey_range(reference.voxels, options.tail);
    const BinScale column = bin_scale(of_floating.low, of_floating.high, bins_, false);
    const BinScale row = bin_scale(of_reference.low, of_reference.high, bins_, false);
    const auto last = static_cast<float>(bins_ - 1);
    floating_ = floating.voxels;
    for (float &v : floating_) {
      v = std::isfinite(v) ? std::clamp(column(v), 0.0F, last) : kNowhere;
    }
    for (const float v : sampler_.of_reference(reference.voxels)) {
      row_.push_back(std::isfinite(v) ? bin_at(std::clamp(row(v), 0.0F, last)) : std::uint16_t{0});
    }
    std::size_t regions = 1;
    for (std::size_t d = 0; d < 3; ++d) {
      nodes_[d] = reference.size[d] > 1 ? kNodesPerAxis : 1;
      to_node_[d] = reference.size[d] > 1
                        ? static_cast<float>(kNodesPerAxis - 1) / static_cast<float>(reference.size[d] - 1)
                        : 0.0F;
      regions *= static_cast<std::size_t>(nodes_[d]);
    }
    // All regions of a block in one histogram: row = region * bins + bin.
    blocks_.assign(std::min(sampler_.parts().size(), kMaxBlocks),
                   JointHistogram(static_cast<int>(regions) * bins_, bins_));
    local_ = std::vector<JointHistogram>(regions, JointHistogram(bins_, bins_));
    global_ = local_.front();
  }

  double value(const Eigen::Matrix4d &T_floating_reference) noexcept override {
    sampler_.set_pose(T_floating_reference);
    team_.run_parts(blocks_.size(), [&](std::size_t b) {
      blocks_[b].clear();
      for (std::size_t p = b; p < sampler_.parts().size(); p += blocks_.size()) {
        add_part(sampler_.parts()[p], blocks_[b]);
      }
    });
    for (std::size_t b = 1; b < blocks_.size(); ++b) {
      blocks_[0].add(blocks_[b]);
    }
    return summarise();
  }
  [[nodiscard]] std::size_t samples() const noexcept override { return sampler_.size(); }

private:
  static constexpr std::size_t kMaxBlocks = 4;

  void add_part(const PairSampler::Part &part, JointHistogram &into) noexcept {
    sampler_.sample(part, floating_, nearest_, outside_, {mapped_.data()});
    const std::span<float> counts = into.counts();
    const auto bins = static_cast<std::size_t>(bins_);
    for (std::size_t i = part.first; i < part.first + part.samples; ++i) {
      if (!(mapped_[i] == mapped_[i])) {
        continue;
      }
      const std::size_t column = bin_at(mapped_[i]);
      std::array<int, 3> base{};
      std::array<float, 3> fraction{};
      for (std::size_t d = 0; d < 3; ++d) {
        const float at = sampler_.coordinate(d)[i] * to_node_[d];
        base[d] = std::clamp(static_cast<int>(at), 0, std::max(nodes_[d] - 2, 0));
        fraction[d] = at - static_cast<float>(base[d]);
      }
      for (unsigned corner = 0; corner < 8; ++corner) {
        float weight = 1.0F;
        int region = 0;
        for (std::size_t d = 3; d-- > 0;) {
          const bool upper = ((corner >> d) & 1U) != 0;
          weight *= upper ? fraction[d] : 1.0F - fraction[d];
          region = region * nodes_[d] + std::min(base[d] + (upper ? 1 : 0), nodes_[d] - 1);
        }
        if (weight > 0.0F) {
          counts[(static_cast<std::size_t>(region) * bins + row_[i]) * bins + column] += weight;
        }
      }
    }
  }

  double summarise() noexcept {
    const std::size_t size = static_cast<std::size_t>(bins_) * static_cast<std::size_t>(bins_);
    double total = 0.0;
    global_.clear();
    for (std::size_t region = 0; region < local_.size(); ++region) {
      const std::span<const float> counts = std::span<const float>(blocks_[0].counts()).subspan(region * size, size);
      std::copy(counts.begin(), counts.end(), local_[region].counts().begin());
      global_.add(local_[region]);
      total += local_[region].summarise().samples;
    }
    const double possible = static_cast<double>(sampler_.size()) * sampler_.reachable();
    overlap_ = possible > 0.0 ? total / possible : 0.0;
    if (!(overlap_ > 0.0 && overlap_ >= min_overlap_)) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    double sum = 0.0;
    double weights = 0.0;
    for (JointHistogram &local : local_) {
      const double samples = local.entropies().samples;
      if (!(samples > 0.0)) {
        continue;
      }
      if (kind_ == Kind::kSpatiallyEncoded) {
        const float of_local = kLambda / static_cast<float>(samples);
        const float of_global = (1.0F - kLambda) / static_cast<float>(total);
        for (std::size_t i = 0; i < size; ++i) {
          local.counts()[i] = of_local * local.counts()[i] + of_global * global_.counts()[i];
        }
        local.summarise();
      }
      const double weight = kind_ == Kind::kConditional ? samples : 1.0; // (12): p(x)
      sum += weight * local.entropies().mutual_information();
      weights += weight;
    }
    return sum / weights;
  }

  Kind kind_;
  int bins_;
  bool nearest_;
  float outside_;
  double min_overlap_;
  parallel::Team &team_;
  PairSampler sampler_;
  std::vector<float> floating_, mapped_;
  std::vector<std::uint16_t> row_;
  std::array<int, 3> nodes_{};
  std::array<float, 3> to_node_{};
  std::vector<JointHistogram> blocks_, local_;
  JointHistogram global_{1, 1};
};

} // namespace

MeasurePointer make_c_mi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                         parallel::Team &team) {
  return std::make_unique<RegionalMeasure>(Kind::kConditional, reference, floating, options, team);
}
MeasurePointer make_semi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                         parallel::Team &team) {
  return std::make_unique<RegionalMeasure>(Kind::kSpatiallyEncoded, reference, floating, options, team);
}

} // namespace bregma::intensity
