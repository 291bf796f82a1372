// The part of the background's signal that is lost in the foreground, per pixel, 0 to 1. Private to the search for
// coils.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <tl/expected.hpp>

#include "algorithms/mri/coils/artefacts.hpp"

namespace bregma::mri {

class LostSignal {
public:
  // What the background alone allows: refuses one without signal, or saturated. The background must outlive this.
  [[nodiscard]] static tl::expected<LostSignal, std::string> start(const Stack &background,
                                                                   const ArtefactOptions &options);
  // One slice of the foreground, row-major, in any order.
  void add(int k, std::span<const float> foreground);
  // Once all are there; see find_artefacts.
  [[nodiscard]] tl::expected<void, std::string> check() const;

  [[nodiscard]] const image::Grid<3> &grid() const { return values_; }
  [[nodiscard]] float at(int i, int j, int k) const { return values_.at(i, j, k); }
  [[nodiscard]] cv::Mat slice(int k) const; // refers to this object's memory
  [[nodiscard]] double volume_mm3(int k) const { return volumes_mm3_[static_cast<std::size_t>(k)]; }
  [[nodiscard]] double mean_within(int k, double column, double row, double radius_px) const;
  [[nodiscard]] double noise() const; // of the difference
  [[nodiscard]] double signal() const { return signal_; }
  [[nodiscard]] double relative_noise() const { return noise() / signal_; }

private:
  const Stack *background_ = nullptr;
  ArtefactOptions options_;
  Stack values_;
  std::vector<double> volumes_mm3_;
  std::vector<double> gains_;  // of each slice: foreground over background; 0 where the background shows too little
  std::vector<double> noises_; // of the slices with signal
  std::vector<bool> added_;
  double signal_ = 1.0;
  double lost_mm3_ = 0.0, gained_mm3_ = 0.0, shown_mm3_ = 0.0;
  // Pixels of the foreground with signal, its highest value, and pixels that have it.
  double shown_pixels_ = 0.0, highest_ = 0.0, at_highest_ = 0.0;
};

} // namespace bregma::mri
