// Joint histograms of two images, their entropies, and the derivative of mutual information.
//
// The reference selects the row, the floating image the columns. All memory is allocated by the constructor. A
// histogram is used by one thread at a time.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace bregma::intensity {

// How the grey value of the floating image between its voxels enters the histogram.
enum class Interpolation {
  kNearest,       // the nearest voxel's value into its bin
  kLinear,        // the linearly interpolated value into its bin
  kPartialVolume, // the neighbouring voxels' values into their bins, each with its weight [Maes 1997]
  kParzen,        // the linearly interpolated value spread over four bins by a cubic B-spline [Mattes 2003]
};

inline constexpr int kMinBins = 8;
inline constexpr int kMaxBins = 256;

// Entropies in nats, of the overlap.
struct Entropies {
  double reference = 0.0, floating = 0.0, joint = 0.0;
  double samples = 0.0; // total weight in the histogram

  [[nodiscard]] double mutual_information() const { return reference + floating - joint; } // (25)
  // (36); 1 for independent images, and where both are constant.
  [[nodiscard]] double normalised() const { return joint > 0.0 ? (reference + floating) / joint : 1.0; }
};

// From a grey value to the coordinate of its bin: value 0 is the centre of bin 0.
struct BinScale {
  float low = 0.0F, factor = 0.0F, offset = 0.0F;
  [[nodiscard]] float operator()(float grey) const { return (grey - low) * factor + offset; }
};
// Bins of the values from low to high. With margin, one bin is left free at each side for the cubic B-spline.
[[nodiscard]] BinScale bin_scale(float low, float high, int bins, bool margin);

// The bin at a coordinate that is not negative. Rounding by lround() would dominate the loops.
[[nodiscard]] inline std::uint16_t bin_at(float coordinate) {
  return static_cast<std::uint16_t>(coordinate + 0.5F); // NOLINT(bugprone-incorrect-roundings)
}

class JointHistogram {
public:
  JointHistogram(int rows, int columns);

  [[nodiscard]] int rows() const { return rows_; }
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] std::span<float> counts() { return counts_; } // rows() x columns(), row by row
  void clear() noexcept;
  void add(const JointHistogram &other) noexcept; // of the same shape

  // Adds samples: row of each, and the coordinate of its column; pairs whose column is NaN are left out.
  void add_binned(std::span<const std::uint16_t> row, std::span<const float> column) noexcept;
  void add_parzen(std::span<const std::uint16_t> row, std::span<const float> column) noexcept;

  // Entropies of the counts.
  const Entropies &summarise() noexcept;
  [[nodiscard]] const Entropies &entropies() const { return entropies_; }

  // Derivative of the mutual information, or of the normalised one, with respect to one sample's move from bin to bin,
  // up to a constant: to be called after summarise(); replaces the counts.
  void differentiate(bool normalised) noexcept;
  // For each sample, derivative of the measure with respect to the coordinate of its column; 0 for NaN. `slope` may be
  // `column`.
  void parzen_slopes(std::span<const std::uint16_t> row, std::span<const float> column,
                     std::span<float> slope) const noexcept;

private:
  int rows_, columns_;
  std::vector<float> counts_;
  std::vector<double> row_sum_, column_sum_;
  Entropies entropies_;
};

} // namespace bregma::intensity
