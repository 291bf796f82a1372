#include "algorithms/intensity/similarity_measure.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "algorithms/intensity/histogram_measure.hpp"
#include "algorithms/intensity/variants.hpp"

namespace bregma::intensity {

namespace {

using Channel = HistogramMeasure::Channel;

constexpr int kSecondOrderBins = 16; // [Rueckert 2000]

bool of_single_voxels(Measure measure) {
  switch (measure) {
  case Measure::kMi:
  case Measure::kNmi:
  case Measure::kGmi:
  case Measure::kAmi:
  case Measure::kMfMi:
  case Measure::kLleHe:
    return true;
  default:
    return false;
  }
}

void check(Measure measure, const MeasureOptions &options) {
  if (options.bins < kMinBins || options.bins > kMaxBins) {
    throw std::invalid_argument("bins: " + std::to_string(options.bins) + " is not from " + std::to_string(kMinBins) +
                                " to " + std::to_string(kMaxBins));
  }
  if (options.interpolation == Interpolation::kPartialVolume && !of_single_voxels(measure)) {
    throw std::invalid_argument("partial volume interpolation: " + std::string(name_of(measure)) +
                                " needs interpolated values");
  }
  if (measure == Measure::kMfMi) {
    if (options.features.empty()) {
      throw std::invalid_argument("features: mf-mi needs at least one");
    }
    if (!options.weights.empty() && options.weights.size() != options.features.size()) {
      throw std::invalid_argument("weights: " + std::to_string(options.weights.size()) + " for " +
                                  std::to_string(options.features.size()) + " features");
    }
  }
}

double entropy_of(const std::vector<float> &values, int bins) {
  const GreyRange range = grey_range(values);
  const BinScale scale = bin_scale(range.low, range.high, bins, false);
  JointHistogram histogram(1, bins);
  for (const float v : values) {
    if (v == v) {
      histogram.counts()[bin_at(scale(v))] += 1.0F;
    }
  }
  return histogram.summarise().floating;
}

std::unique_ptr<HistogramMeasure> of_features(const std::vector<Feature> &features, std::vector<double> weights,
                                              bool normalised, const Volume &reference, const Volume &floating,
                                              const MeasureOptions &options, parallel::Team &team) {
  std::vector<Channel> channels;
  std::vector<double> entropies;
  for (const Feature feature : features) {
    channels.push_back(
        {feature_of(reference, feature, options.aig, team), feature_of(floating, feature, options.aig, team)});
    if (weights.empty()) {
      entropies.push_back(entropy_of(channels.back().reference, options.bins) +
                          entropy_of(channels.back().floating, options.bins));
    }
  }
  if (weights.empty()) {
    weights = rank_weights(entropies);
  }
  for (std::size_t i = 0; i < channels.size(); ++i) {
    channels[i].weight = weights[i];
  }
  return std::make_unique<HistogramMeasure>(reference, floating, std::move(channels), normalised, options, team);
}

} // namespace

std::string_view name_of(Measure measure) {
  const auto *const at =
      std::find_if(kMeasures.begin(), kMeasures.end(), [&](const MeasureName &m) { return m.measure == measure; });
  return at->name;
}

double SimilarityMeasure::value_and_gradient(const Eigen::Matrix4d &T_floating_reference,
                                             AffineGradient &gradient) noexcept {
  gradient.setZero();
  return value(T_floating_reference);
}

std::vector<double> rank_weights(const std::vector<double> &entropies) {
  const std::size_t n = entropies.size();
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return entropies[a] < entropies[b]; });
  std::vector<double> out(n);
  for (std::size_t rank = 0; rank < n; ++rank) {
    out[order[rank]] = 2.0 * static_cast<double>(rank + 1) / static_cast<double>(n * (n + 1));
  }
  return out;
}

std::unique_ptr<HistogramMeasure> make_histogram_measure(Measure measure, const Volume &reference,
                                                         const Volume &floating, const MeasureOptions &options,
                                                         parallel::Team &team) {
  check(measure, options);
  const auto single = [&](Feature feature, bool normalised) {
    return of_features({feature}, {1.0}, normalised, reference, floating, options, team);
  };
  switch (measure) {
  case Measure::kMi:
    return single(Feature::kGrey, false);
  case Measure::kNmi:
    return single(Feature::kGrey, true);
  case Measure::kGmi:
    return single(Feature::kGradient, true);
  case Measure::kAmi:
    return single(Feature::kSignificance, true);
  case Measure::kMfMi:
    return of_features(options.features, options.weights, true, reference, floating, options, team);
  default:
    throw std::invalid_argument("measure: " + std::string(name_of(measure)) + " is no sum of mutual information");
  }
}

MeasurePointer make_measure(Measure measure, const Volume &reference, const Volume &floating,
                            const MeasureOptions &options, parallel::Team &team) {
  check(measure, options);
  switch (measure) {
  case Measure::kMi:
  case Measure::kNmi:
  case Measure::kGmi:
  case Measure::kAmi:
  case Measure::kMfMi:
    return make_histogram_measure(measure, reference, floating, options, team);
  case Measure::kCorrelation:
    return make_correlation(reference, floating, options, team);
  case Measure::kQMi:
    return make_q_mi(reference, floating, options, team);
  case Measure::kGiMi:
    return make_gi_mi(reference, floating, options, team);
  case Measure::kRmi:
    return make_rmi(reference, floating, options, team);
  case Measure::kCmi:
    return make_c_mi(reference, floating, options, team);
  case Measure::kSemi:
    return make_semi(reference, floating, options, team);
  case Measure::kSecondOrderMi: {
    MeasureOptions with_few_bins = options;
    with_few_bins.bins = kSecondOrderBins;
    return make_second_order_mi(reference, floating, with_few_bins, team);
  }
  case Measure::kLleHe:
    return make_lle_he(reference, floating, options, team);
  }
  throw std::invalid_argument("measure: not one of kMeasures");
}

} // namespace bregma::intensity
