#include "algorithms/intensity/histogram_measure.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

namespace bregma::intensity {

namespace {

std::vector<std::uint16_t> rows_of(const std::vector<float> &values, const BinScale &scale, int rows) {
  std::vector<std::uint16_t> out(values.size());
  std::transform(values.begin(), values.end(), out.begin(), [&](float v) {
    const float bin = std::isfinite(v) ? std::clamp(scale(v), 0.0F, static_cast<float>(rows - 1)) : 0.0F;
    return bin_at(bin);
  });
  return out;
}

} // namespace

HistogramMeasure::HistogramMeasure(const Volume &reference, const Volume &floating, std::vector<Channel> channels,
                                   bool normalised, const MeasureOptions &options, parallel::Team &team)
    : sampler_(reference, floating, options.max_samples, options.seed), interpolation_(options.interpolation),
      normalised_(normalised), min_overlap_(options.min_overlap), team_(team),
      part_gradients_(sampler_.parts().size()) {
  const bool margin = options.interpolation == Interpolation::kParzen;
  for (Channel &from : channels) {
    Prepared channel;
    channel.weight = from.weight;
    const int rows = from.rows > 0 ? from.rows : options.bins;
    const GreyRange of_reference = grey_range(from.reference, options.tail);
    const BinScale row_scale =
        from.rows > 0 ? BinScale{0.0F, 1.0F, 0.0F} : bin_scale(of_reference.low, of_reference.high, rows, false);
    channel.row = rows_of(sampler_.of_reference(from.reference), row_scale, rows);
    const GreyRange of_floating = grey_range(from.floating, options.tail);
    const BinScale scale = bin_scale(of_floating.low, of_floating.high, options.bins, margin);
    const float first = scale(of_floating.low);
    const float last = std::max(scale(of_floating.high), first);
    channel.floating = std::move(from.floating);
    for (float &v : channel.floating) {
      v = std::isfinite(v) ? std::clamp(scale(v), first, last) : std::numeric_limits<float>::quiet_NaN();
    }
    channel.outside = options.outside == Outside::kDark ? first : std::numeric_limits<float>::quiet_NaN();
    channel.column.resize(sampler_.padded());
    if (has_gradient()) {
      for (auto *list : {&channel.dx, &channel.dy, &channel.dz}) {
        list->resize(sampler_.padded());
      }
    }
    channel.parts.assign(sampler_.parts().size(), JointHistogram(rows, options.bins));
    channels_.push_back(std::move(channel));
  }
}

bool HistogramMeasure::has_gradient() const noexcept { return interpolation_ == Interpolation::kParzen; }

void HistogramMeasure::fill(Prepared &channel, std::size_t part, bool with_slopes) noexcept {
  JointHistogram &histogram = channel.parts[part];
  const PairSampler::Part &of = sampler_.parts()[part];
  histogram.clear();
  const auto row = std::span<const std::uint16_t>(channel.row).subspan(of.first, of.samples);
  if (interpolation_ == Interpolation::kPartialVolume) {
    const auto columns = static_cast<std::size_t>(histogram.columns());
    const std::span<float> counts = histogram.counts();
    PairSampler::Neighbours around{};
    for (std::size_t i = 0; i < row.size(); ++i) {
      const bool inside = sampler_.neighbours(of.first + i, around);
      if (!inside) {
        if (channel.outside == channel.outside) {
          counts[row[i] * columns + bin_at(channel.outside)] += 1.0F;
        }
        continue;
      }
      for (std::size_t corner = 0; corner < 8; ++corner) {
        const float bin = channel.floating[around.offset[corner]];
        if (bin == bin) {
          counts[row[i] * columns + bin_at(bin)] += around.weight[corner];
        }
      }
    }
    return;
  }
  sampler_.sample(of, channel.floating, interpolation_ == Interpolation::kNearest, channel.outside,
                  with_slopes
                      ? SampledValues{channel.column.data(), channel.dx.data(), channel.dy.data(), channel.dz.data()}
                      : SampledValues{channel.column.data()});
  const auto column = std::span<const float>(channel.column).subspan(of.first, of.samples);
  if (interpolation_ == Interpolation::kParzen) {
    histogram.add_parzen(row, column);
  } else {
    histogram.add_binned(row, column);
  }
}

double HistogramMeasure::evaluate(const Eigen::Matrix4d &T_floating_reference, bool with_slopes) noexcept {
  sampler_.set_pose(T_floating_reference);
  const std::size_t parts = sampler_.parts().size();
  // Channels and parts in one list, so that few parts of several channels are shared as well.
  team_.run_parts(parts * channels_.size(), [&](std::size_t i) { fill(channels_[i / parts], i % parts, with_slopes); });
  double sum = 0.0;
  overlap_ = 0.0;
  for (Prepared &channel : channels_) {
    for (std::size_t part = 1; part < parts; ++part) {
      channel.parts[0].add(channel.parts[part]);
    }
    const Entropies &h = channel.parts[0].summarise();
    if (overlap_ == 0.0 && sampler_.size() > 0) {
      overlap_ = h.samples / (static_cast<double>(sampler_.size()) * sampler_.reachable());
    }
    sum += channel.weight * (normalised_ ? h.normalised() : h.mutual_information());
  }
  return overlap_ >= min_overlap_ && overlap_ > 0.0 ? sum : std::numeric_limits<double>::quiet_NaN();
}

double HistogramMeasure::value(const Eigen::Matrix4d &T_floating_reference) noexcept {
  return evaluate(T_floating_reference, false);
}

Affine34 HistogramMeasure::gradient_of(Prepared &channel, const PairSampler::Part &part) const noexcept {
  const auto row = std::span<const std::uint16_t>(channel.row).subspan(part.first, part.samples);
  const auto column = std::span<float>(channel.column).subspan(part.first, part.samples);
  channel.parts[0].parzen_slopes(row, column, column); // in place: each slope needs its own column only
  using List = Eigen::Map<const Eigen::ArrayXf>;
  Affine34 out = Affine34::Zero();
  const std::array<const std::vector<float> *, 3> derivative{&channel.dx, &channel.dy, &channel.dz};
  // Blocks: a float sum over many samples would lose digits.
  constexpr std::size_t kBlock = 1024;
  for (std::size_t first = part.first; first < part.first + part.samples; first += kBlock) {
    const auto count = static_cast<Eigen::Index>(std::min(kBlock, part.first + part.samples - first));
    const List slope(channel.column.data() + first, count);
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const List d(derivative[static_cast<std::size_t>(axis)]->data() + first, count);
      const auto force = slope * d;
      for (Eigen::Index column_of = 0; column_of < 3; ++column_of) {
        const List position(sampler_.coordinate(static_cast<std::size_t>(column_of)) + first, count);
        out(axis, column_of) += static_cast<double>((force * position).sum());
      }
      out(axis, 3) += static_cast<double>(force.sum());
    }
  }
  return out;
}

double HistogramMeasure::value_and_forces(const Eigen::Matrix4d &T_floating_reference,
                                          const std::array<float *, 3> &forces) noexcept {
  const double out = evaluate(T_floating_reference, true);
  bool first = true;
  for (Prepared &channel : channels_) {
    channel.parts[0].differentiate(normalised_);
    const std::array<const std::vector<float> *, 3> derivative{&channel.dx, &channel.dy, &channel.dz};
    const auto weight = static_cast<float>(channel.weight);
    team_.run_parts(sampler_.parts().size(), [&](std::size_t p) {
      const PairSampler::Part &part = sampler_.parts()[p];
      const auto column = std::span<float>(channel.column).subspan(part.first, part.samples);
      channel.parts[0].parzen_slopes(std::span<const std::uint16_t>(channel.row).subspan(part.first, part.samples),
                                     column, column);
      for (std::size_t d = 0; d < 3; ++d) {
        const float *slope = derivative[d]->data() + part.first;
        float *force = forces[d] + part.first;
        for (std::size_t i = 0; i < part.samples; ++i) {
          force[i] = (first ? 0.0F : force[i]) + weight * column[i] * slope[i];
        }
      }
    });
    first = false;
  }
  return out;
}

double HistogramMeasure::value_and_gradient(const Eigen::Matrix4d &T_floating_reference,
                                            AffineGradient &gradient) noexcept {
  const double out = evaluate(T_floating_reference, true);
  const std::size_t parts = sampler_.parts().size();
  Affine34 sum = Affine34::Zero();
  for (Prepared &channel : channels_) {
    channel.parts[0].differentiate(normalised_);
    team_.run_parts(parts,
                    [&](std::size_t part) { part_gradients_[part] = gradient_of(channel, sampler_.parts()[part]); });
    for (const Affine34 &part : part_gradients_) {
      sum += channel.weight * part;
    }
  }
  gradient = sampler_.to_mm(sum);
  return out;
}

} // namespace bregma::intensity
