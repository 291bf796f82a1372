// The part of the background's signal that is lost in the foreground, per pixel, 0 to 1. Private to the search for
// coils.
#pragma once

#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <tl/expected.hpp>

#include "algorithms/mri/coils/artefacts.hpp"

namespace bregma::mri {

class LostSignal {
public:
  // Refuses pairs that do not belong together; see find_artefacts.
  [[nodiscard]] static tl::expected<LostSignal, std::string> between(const Stack &background, const Stack &foreground,
                                                                     const ArtefactOptions &options);

  [[nodiscard]] const image::Grid<3> &grid() const { return values_; }
  [[nodiscard]] float at(int i, int j, int k) const { return values_.at(i, j, k); }
  [[nodiscard]] cv::Mat slice(int k) const; // refers to this object's memory
  [[nodiscard]] double volume_mm3(int k) const { return volumes_mm3_[static_cast<std::size_t>(k)]; }
  [[nodiscard]] double mean_within(int k, double column, double row, double radius_px) const;
  [[nodiscard]] double noise() const { return noise_; }
  [[nodiscard]] double signal() const { return signal_; }
  [[nodiscard]] double relative_noise() const { return noise_ / signal_; }

private:
  Stack values_;
  std::vector<double> volumes_mm3_;
  double noise_ = 0.0, signal_ = 1.0;
};

} // namespace bregma::mri
