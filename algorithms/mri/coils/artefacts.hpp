// Active coils in a pair of image stacks: what the current took away, found and located [Tuna 2022, IV-B].
//
// The background is subtracted from the foreground and the lost part of the signal is taken relative to the background.
// Slice by slice a Hough transform finds circles; circles of neighbouring slices are one coil. Centroid and area of the
// artefact in each slice give the area-weighted mean over the slices. Here area and centroid come from the lost part of
// every pixel around the circle, which is finer than a circle's radius. kHoughCircles takes the circles as they are, as
// the paper does, and kSingleSlice the largest of them alone.
//
// Frame: that of the stacks' T_image_index, mm. Pure functions, any thread; they allocate.
#pragma once

#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <tl/expected.hpp>

#include "algorithms/image/grid.hpp"

namespace bregma::mri {

using Stack = image::Image<float, 3>;

enum class CoilMethod { kMultiSlice, kHoughCircles, kSingleSlice };

struct ArtefactOptions {
  CoilMethod method = CoilMethod::kMultiSlice;
  double min_radius_mm = 2.5; // of an artefact's circle
  double max_radius_mm = 11.0;
  double min_lost = 0.35;       // part of the signal that is lost where an artefact is
  double window_mm = 12.0;      // around a coil: signal farther away does not count
  double max_lost_part = 0.2;   // of all signal: above it the two stacks do not show the same scene
  double max_saturated = 0.002; // part of the pixels with signal that have the highest value
};

struct CoilArtefact {
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); // mm^2, see artefacts.cpp
  double area_mm2 = 0.0;                                // in the slice where it is largest
  double volume_mm3 = 0.0;                              // lost signal over all slices
  int slices = 0;                                       // in which a circle was found
  bool cut_off = false; // reaches the first or the last slice, or the border: its centre is not known
  // By which B0 displaces it in the scan whose read-out is forward; NaN unless both read-outs show it.
  Eigen::Vector3d b0_mm = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
};

struct ArtefactSearch {
  std::vector<CoilArtefact> artefacts; // largest first
  double noise = 0.0;                  // one sigma of the difference, in units of the pixels
  double signal = 0.0;                 // of the background: its 90th percentile
};

// Slices of the foreground one by one, as they come from the scanner: what a slice shows is worked out at once, so that
// little is left after the last one. The background must outlive this. Not for several threads at a time.
class ArtefactFinder {
public:
  // Otherwise a sentence: no signal, saturated pixels.
  [[nodiscard]] static tl::expected<ArtefactFinder, std::string> start(const Stack &background,
                                                                       const ArtefactOptions &options = {});
  ArtefactFinder(ArtefactFinder &&) noexcept;
  ArtefactFinder &operator=(ArtefactFinder &&) noexcept;
  ~ArtefactFinder();

  // Slice k (0 to size[2] - 1), row-major, in any order. False, and nothing done, for another k or number of pixels.
  bool add(int k, std::span<const float> foreground);
  // Otherwise a sentence, as find_artefacts; also for slices that are missing.
  [[nodiscard]] tl::expected<ArtefactSearch, std::string> finish() const;

private:
  struct State;
  explicit ArtefactFinder(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

// Otherwise a sentence that says what is wrong with the input: different grids, saturated pixels, no signal, a
// foreground of another scene or brightness, a pair in the wrong order.
[[nodiscard]] tl::expected<ArtefactSearch, std::string> find_artefacts(const Stack &background, const Stack &foreground,
                                                                       const ArtefactOptions &options = {});

// Coils of two foregrounds, one with the current reversed: the mean of both places. A coil that the second one does not
// show near the first (half of window_mm) stays where it is.
[[nodiscard]] std::vector<CoilArtefact> mean_of_polarities(std::span<const CoilArtefact> positive,
                                                           std::span<const CoilArtefact> negative, double window_mm);

// Coils that two scans of the same slices show, one with its read-out reversed. B0 displaces a coil along the read-out,
// oppositely in both, so the mean of its two places is free of that, whatever the field is. Along the normal of the
// slices B0 displaces both alike; that remains. What only one of the scans shows (within window_mm) is left out.
[[nodiscard]] std::vector<CoilArtefact> mean_of_read_outs(std::span<const CoilArtefact> forward,
                                                          std::span<const CoilArtefact> reversed, double window_mm);

} // namespace bregma::mri
