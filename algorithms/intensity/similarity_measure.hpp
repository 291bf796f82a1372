// Measures of the similarity of two images under an affine map, for registration: one interface for all.
//
// The reference is compared, at fixed places (samples), with the floating image mapped onto it. Larger is better.
// Images in the plane are volumes with one slice. NaN in an image marks voxels without a value (masks). Measures keep
// what they need of the images. Memory is allocated when a measure is made; an evaluation allocates nothing and does
// not throw. It runs on the team's threads, and its value does not depend on their number. One thread at a time may
// evaluate.
//
// Sources: thesis, chapters 2, 4 and 5; docs/images.md states where its formulas cannot be used as printed.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "algorithms/intensity/features.hpp"
#include "algorithms/intensity/joint_histogram.hpp"
#include "algorithms/parallel/team.hpp"

namespace bregma::intensity {

enum class Measure {
  kMi,            // mutual information (24)
  kNmi,           // normalised (36)
  kGmi,           // NMI of the gradient magnitudes
  kAmi,           // NMI of the significance images (37)
  kMfMi,          // weighted sum of the NMI of several features (38)
  kCorrelation,   // magnitude of the correlation coefficient
  kQMi,           // MI weighted by the voxels' saliency (6)
  kGiMi,          // NMI times agreement of the gradients (7)-(9)
  kRmi,           // of neighbourhoods, as Gaussians (10), (11)
  kCmi,           // conditional on the region (12)
  kSemi,          // spatially encoded, mixed with the global histogram (13)
  kSecondOrderMi, // of pairs of neighbours, 16 bins (14)
  kLleHe,         // hybrid entropy with a fused ordinal feature (15)
};
struct MeasureName {
  Measure measure;
  std::string_view name; // for command lines and tables
};
inline constexpr std::array<MeasureName, 13> kMeasures{{{Measure::kMi, "mi"},
                                                        {Measure::kNmi, "nmi"},
                                                        {Measure::kGmi, "gmi"},
                                                        {Measure::kAmi, "ami"},
                                                        {Measure::kMfMi, "mf-mi"},
                                                        {Measure::kCorrelation, "correlation"},
                                                        {Measure::kQMi, "q-mi"},
                                                        {Measure::kGiMi, "gi-mi"},
                                                        {Measure::kRmi, "rmi"},
                                                        {Measure::kCmi, "cmi"},
                                                        {Measure::kSemi, "semi"},
                                                        {Measure::kSecondOrderMi, "second-order"},
                                                        {Measure::kLleHe, "lle-he"}}};
[[nodiscard]] std::string_view name_of(Measure measure);

enum class Outside {
  kLeftOut, // samples outside the floating image are not compared
  kDark, // they are compared with its smallest value, as where an image was rotated and its corners filled with zeros
};

struct MeasureOptions {
  int bins = 64; // kMinBins to kMaxBins; second-order MI: 16
  Interpolation interpolation = Interpolation::kParzen;
  Outside outside = Outside::kLeftOut;
  double tail = 0.0;           // fraction of the voxels beyond each end of the range of grey values
  std::size_t max_samples = 0; // 0: all voxels; measures that look at neighbours always take all
  std::uint64_t seed = 1;
  double min_overlap = 0.05; // of the smaller image; below it a value is NaN
  AigReading aig = AigReading::kDistanceTimesGrey;
  std::vector<Feature> features = {Feature::kGrey, Feature::kAig}; // of MF-MI
  std::vector<double> weights = {};                                // of the features; empty: ranked by entropy (39)
};

// d(value) / d(upper three rows of T_floating_reference), rotation and scale per mm of the reference's coordinates.
using AffineGradient = Eigen::Matrix<double, 3, 4>;

class SimilarityMeasure {
public:
  SimilarityMeasure() = default;
  virtual ~SimilarityMeasure() = default;
  SimilarityMeasure(const SimilarityMeasure &) = delete;
  SimilarityMeasure &operator=(const SimilarityMeasure &) = delete;

  // NaN with too little overlap.
  [[nodiscard]] virtual double value(const Eigen::Matrix4d &T_floating_reference) noexcept = 0;
  // Whether the derivative is known in closed form. The effect of samples that leave the overlap is not in it.
  [[nodiscard]] virtual bool has_gradient() const noexcept { return false; }
  // Only with has_gradient().
  [[nodiscard]] virtual double value_and_gradient(const Eigen::Matrix4d &T_floating_reference,
                                                  AffineGradient &gradient) noexcept;
  // Of the last evaluation: fraction of the smaller image that the other one covers.
  [[nodiscard]] double overlap() const noexcept { return overlap_; }
  // Samples that an evaluation compares.
  [[nodiscard]] virtual std::size_t samples() const noexcept = 0;

protected:
  double overlap_ = 0.0;
};

// Throws std::invalid_argument: bins out of range, no feature, weights that do not fit the features, partial volume
// with a measure that has no histogram of single voxels.
[[nodiscard]] std::unique_ptr<SimilarityMeasure> make_measure(Measure measure, const Volume &reference,
                                                              const Volume &floating, const MeasureOptions &options,
                                                              parallel::Team &team);

// Weights by rank of the entropies, 1 to N over their sum: (39) with all comparisons, and scaled to a sum of one.
[[nodiscard]] std::vector<double> rank_weights(const std::vector<double> &entropies);

} // namespace bregma::intensity
