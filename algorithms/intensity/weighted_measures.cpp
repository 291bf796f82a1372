// Correlation, Q-MI and GI-MI: sums over single voxels with more than one value at each.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "algorithms/intensity/pair_sampler.hpp"
#include "algorithms/intensity/resolution.hpp"
#include "algorithms/intensity/saliency.hpp"
#include "algorithms/intensity/variants.hpp"

namespace bregma::intensity {

namespace {

constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();

// Values of several images at the samples of a pair.
class Samples {
public:
  Samples(const Volume &reference, const Volume &floating, const MeasureOptions &options, parallel::Team &team)
      : sampler(reference, floating, options.max_samples, options.seed), team_(team),
        nearest_(options.interpolation == Interpolation::kNearest), min_overlap_(options.min_overlap) {}

  // An image on the floating image's grid; outside: its value there.
  void add(std::vector<float> floating, float outside) {
    channels_.push_back({std::move(floating), std::vector<float>(sampler.padded()), outside});
  }
  [[nodiscard]] const std::vector<float> &mapped(std::size_t channel) const { return channels_[channel].mapped; }

  // Samples all channels and then calls job(part, its number) for each part.
  template <class Job> void for_parts(const Eigen::Matrix4d &T_floating_reference, const Job &job) noexcept {
    sampler.set_pose(T_floating_reference);
    team_.run_parts(sampler.parts().size(), [&](std::size_t p) {
      for (Channel &channel : channels_) {
        sampler.sample(sampler.parts()[p], channel.floating, nearest_, channel.outside, {channel.mapped.data()});
      }
      job(sampler.parts()[p], p);
    });
  }
  // Fraction of the smaller image; and whether that is enough.
  [[nodiscard]] std::pair<double, bool> overlap(double compared) const {
    const double fraction =
        sampler.size() > 0 ? compared / (static_cast<double>(sampler.size()) * sampler.reachable()) : 0.0;
    return {fraction, fraction > 0.0 && fraction >= min_overlap_};
  }

  PairSampler sampler;

private:
  struct Channel {
    std::vector<float> floating, mapped;
    float outside;
  };
  parallel::Team &team_;
  bool nearest_;
  double min_overlap_;
  std::vector<Channel> channels_;
};

float outside_value(const MeasureOptions &options, const GreyRange &range) {
  return options.outside == Outside::kDark ? range.low : kMissing;
}

class Correlation final : public SimilarityMeasure {
public:
  Correlation(const Volume &reference, const Volume &floating, const MeasureOptions &options, parallel::Team &team)
      : samples_(reference, floating, options, team), reference_(samples_.sampler.of_reference(reference.voxels)),
        sums_(samples_.sampler.parts().size()) {
    samples_.add(floating.voxels, outside_value(options, grey_range(floating.voxels)));
  }

  double value(const Eigen::Matrix4d &T_floating_reference) noexcept override {
    samples_.for_parts(T_floating_reference, [&](const PairSampler::Part &part, std::size_t p) {
      Sums sum;
      for (std::size_t i = part.first; i < part.first + part.samples; ++i) {
        const float f = samples_.mapped(0)[i];
        if (f == f) {
          const Eigen::Vector2d v(static_cast<double>(reference_[i]), static_cast<double>(f));
          sum.count += 1.0;
          sum.first += v;
          sum.second += v * v.transpose();
        }
      }
      sums_[p] = sum;
    });
    Sums sum;
    for (const Sums &part : sums_) {
      sum.count += part.count;
      sum.first += part.first;
      sum.second += part.second;
    }
    const auto [fraction, enough] = samples_.overlap(sum.count);
    overlap_ = fraction;
    if (!enough) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    const Eigen::Matrix2d C = sum.second / sum.count - sum.first * sum.first.transpose() / (sum.count * sum.count);
    const double product = C(0, 0) * C(1, 1);
    return product > 0.0 ? std::abs(C(0, 1)) / std::sqrt(product) : 0.0;
  }
  [[nodiscard]] std::size_t samples() const noexcept override { return samples_.sampler.size(); }

private:
  struct Sums {
    double count = 0.0;
    Eigen::Vector2d first = Eigen::Vector2d::Zero();
    Eigen::Matrix2d second = Eigen::Matrix2d::Zero();
  };
  Samples samples_;
  std::vector<float> reference_;
  std::vector<Sums> sums_;
};

// Bins of the reference's samples and, on its grid, of the floating image.
struct Binned {
  std::vector<std::uint16_t> row;
  std::vector<float> floating;
  BinScale scale;
};
Binned binned(const PairSampler &sampler, const Volume &reference, const Volume &floating,
              const MeasureOptions &options) {
  const GreyRange of_reference = grey_range(reference.voxels, options.tail);
  const GreyRange of_floating = grey_range(floating.voxels, options.tail);
  const BinScale rows = bin_scale(of_reference.low, of_reference.high, options.bins, false);
  Binned out;
  out.scale = bin_scale(of_floating.low, of_floating.high, options.bins, false);
  const auto last = static_cast<float>(options.bins - 1);
  for (const float v : sampler.of_reference(reference.voxels)) {
    out.row.push_back(std::isfinite(v) ? bin_at(std::clamp(rows(v), 0.0F, last)) : std::uint16_t{0});
  }
  out.floating = floating.voxels;
  for (float &v : out.floating) {
    v = std::isfinite(v) ? std::clamp(out.scale(v), 0.0F, last) : kMissing;
  }
  return out;
}

class QualitativeMi final : public SimilarityMeasure {
public:
  QualitativeMi(const Volume &reference, const Volume &floating, const MeasureOptions &options, parallel::Team &team)
      : samples_(reference, floating, options, team) {
    Binned bins = binned(samples_.sampler, reference, floating, options);
    row_ = std::move(bins.row);
    utility_ = samples_.sampler.of_reference(saliency(reference, team));
    const bool dark = options.outside == Outside::kDark;
    samples_.add(std::move(bins.floating), dark ? 0.0F : kMissing);
    samples_.add(saliency(floating, team), dark ? 0.0F : kMissing);
    counts_.assign(samples_.sampler.parts().size(), JointHistogram(options.bins, options.bins));
    utilities_ = counts_;
    row_sum_.resize(static_cast<std::size_t>(options.bins));
    column_sum_ = row_sum_;
  }

  double value(const Eigen::Matrix4d &T_floating_reference) noexcept override {
    samples_.for_parts(T_floating_reference, [&](const PairSampler::Part &part, std::size_t p) {
      counts_[p].clear();
      utilities_[p].clear();
      const auto columns = static_cast<std::size_t>(counts_[p].columns());
      for (std::size_t i = part.first; i < part.first + part.samples; ++i) {
        const float column = samples_.mapped(0)[i];
        const float utility = utility_[i] * samples_.mapped(1)[i];
        if (utility == utility && column == column) {
          const std::size_t bin = row_[i] * columns + bin_at(column);
          counts_[p].counts()[bin] += 1.0F;
          utilities_[p].counts()[bin] += utility;
        }
      }
    });
    for (std::size_t p = 1; p < counts_.size(); ++p) {
      counts_[0].add(counts_[p]);
      utilities_[0].add(utilities_[p]);
    }
    const auto [fraction, enough] = samples_.overlap(counts_[0].summarise().samples);
    overlap_ = fraction;
    return enough ? weighted_sum() : std::numeric_limits<double>::quiet_NaN();
  }
  [[nodiscard]] std::size_t samples() const noexcept override { return samples_.sampler.size(); }

private:
  // (6): u is the bin's mean utility, so u p is its sum over the number of samples.
  [[nodiscard]] double weighted_sum() noexcept {
    const std::span<const float> counts = counts_[0].counts();
    const double total = counts_[0].entropies().samples;
    const std::size_t columns = column_sum_.size();
    std::fill(row_sum_.begin(), row_sum_.end(), 0.0);
    std::fill(column_sum_.begin(), column_sum_.end(), 0.0);
    for (std::size_t i = 0; i < counts.size(); ++i) {
      row_sum_[i / columns] += static_cast<double>(counts[i]);
      column_sum_[i % columns] += static_cast<double>(counts[i]);
    }
    double sum = 0.0;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      if (counts[i] > 0.0F) {
        sum += static_cast<double>(utilities_[0].counts()[i]) / total *
               std::log(static_cast<double>(counts[i]) * total / (row_sum_[i / columns] * column_sum_[i % columns]));
      }
    }
    return sum;
  }

  Samples samples_;
  std::vector<std::uint16_t> row_;
  std::vector<float> utility_;
  std::vector<JointHistogram> counts_, utilities_; // of each part
  std::vector<double> row_sum_, column_sum_;
};

class GradientMi final : public SimilarityMeasure {
public:
  GradientMi(const Volume &reference, const Volume &floating, const MeasureOptions &options, parallel::Team &team)
      : samples_(reference, floating, options, team), agreement_(samples_.sampler.parts().size()) {
    Binned bins = binned(samples_.sampler, reference, floating, options);
    row_ = std::move(bins.row);
    const bool dark = options.outside == Outside::kDark;
    samples_.add(std::move(bins.floating), dark ? 0.0F : kMissing);
    const Gradient of_reference = at_scale(reference, team);
    reference_ = {samples_.sampler.of_reference(of_reference.x), samples_.sampler.of_reference(of_reference.y),
                  samples_.sampler.of_reference(of_reference.z)};
    Gradient of_floating = at_scale(floating, team);
    for (auto *list : {&of_floating.x, &of_floating.y, &of_floating.z}) {
      samples_.add(std::move(*list), dark ? 0.0F : kMissing);
    }
    parts_.assign(samples_.sampler.parts().size(), JointHistogram(options.bins, options.bins));
  }

  double value(const Eigen::Matrix4d &T_floating_reference) noexcept override {
    samples_.for_parts(T_floating_reference, [&](const PairSampler::Part &part, std::size_t p) {
      parts_[p].clear();
      parts_[p].add_binned(std::span<const std::uint16_t>(row_).subspan(part.first, part.samples),
                           std::span<const float>(samples_.mapped(0)).subspan(part.first, part.samples));
      agreement_[p] = agreement(part);
    });
    double sum = agreement_[0];
    for (std::size_t p = 1; p < parts_.size(); ++p) {
      parts_[0].add(parts_[p]);
      sum += agreement_[p];
    }
    const Entropies &h = parts_[0].summarise();
    const auto [fraction, enough] = samples_.overlap(h.samples);
    overlap_ = fraction;
    return enough ? sum / static_cast<double>(samples_.sampler.size()) * h.normalised()
                  : std::numeric_limits<double>::quiet_NaN();
  }
  [[nodiscard]] std::size_t samples() const noexcept override { return samples_.sampler.size(); }

private:
  static Gradient at_scale(const Volume &image, parallel::Team &team) {
    constexpr double kScale_voxels = 1.5;
    return gradient(smoothed(image, kScale_voxels * image.spacing_mm().head<2>().mean(), team), team);
  }

  // (8) over one part. With c = cos alpha, w = (cos 2 alpha + 1) / 2 = c^2: edges of opposite contrast agree.
  [[nodiscard]] double agreement(const PairSampler::Part &part) const noexcept {
    const Eigen::Matrix3f to_reference = samples_.sampler.linear_part().transpose(); // grad (f o T) = A^T grad f
    double sum = 0.0;
    for (std::size_t i = part.first; i < part.first + part.samples; ++i) {
      const Eigen::Vector3f r(reference_[0][i], reference_[1][i], reference_[2][i]);
      const Eigen::Vector3f f =
          to_reference * Eigen::Vector3f(samples_.mapped(1)[i], samples_.mapped(2)[i], samples_.mapped(3)[i]);
      const float smaller = std::min(r.squaredNorm(), f.squaredNorm());
      const float dot = r.dot(f);
      const float product = r.squaredNorm() * f.squaredNorm();
      if (product > 0.0F) { // false for NaN
        sum += static_cast<double>(dot * dot / product * std::sqrt(smaller));
      }
    }
    return sum;
  }

  Samples samples_;
  std::vector<std::uint16_t> row_;
  std::array<std::vector<float>, 3> reference_;
  std::vector<JointHistogram> parts_;
  std::vector<double> agreement_;
};

} // namespace

MeasurePointer make_correlation(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                parallel::Team &team) {
  return std::make_unique<Correlation>(reference, floating, options, team);
}
MeasurePointer make_q_mi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                         parallel::Team &team) {
  return std::make_unique<QualitativeMi>(reference, floating, options, team);
}
MeasurePointer make_gi_mi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                          parallel::Team &team) {
  return std::make_unique<GradientMi>(reference, floating, options, team);
}

} // namespace bregma::intensity
