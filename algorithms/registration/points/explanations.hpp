// Relations between two lists of points other than a rigid one: what explains pairs that do not fit. A list may be
// mirrored, in another unit, in another order, or contain wrong pairs.
//
// Least squares without stated errors, so a relation is judged by its root mean square residual (RMS) alone. Lengths in
// mm. Allocates; reentrant.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "algorithms/registration/points/paired_points.hpp"

namespace bregma::registration {

struct Explanation {
  enum class Kind { kMirrored, kScaled, kReordered, kWrongPairs };
  Kind kind = Kind::kMirrored;
  double rms_mm = 0.0; // of the relation, over the pairs that it keeps, in the target's unit
  double scale = 1.0;  // kScaled: the target's lengths relative to the source's
  // kWrongPairs: indices of the pairs that the relation leaves out.
  // kReordered: the target point of each source point.
  std::vector<std::size_t> indices;
};

// The relations whose residual is at most limit_mm and less than a third of the rigid one's, smallest residual first.
// The two lists are of equal length, finite and not collinear; fewer than four points explain nothing. An order is
// searched for up to 64 points, two wrong pairs for 7 to 128.
[[nodiscard]] std::vector<Explanation> explain(std::span<const Vector3d> source_mm, std::span<const Vector3d> target_mm,
                                               double limit_mm);

// Points in a plane fit their own mirror image: their distance from it (RMS) is below 3 mm.
[[nodiscard]] bool are_coplanar(std::span<const Vector3d> points_mm) noexcept;

// The pair that contradicts the others although the residuals as a whole look acceptable: without it they shrink so
// much that chance explains it with a probability below false_alarm (F test of the two sums of squares, corrected for
// the number of pairs), and it is more than min_distance_mm from where the others predict it. Five pairs at least.
struct OddPair {
  std::size_t index = 0;
  double from_the_others_mm = 0.0;
};
[[nodiscard]] std::optional<OddPair> find_odd_pair(std::span<const Vector3d> source_mm,
                                                   std::span<const Vector3d> target_mm, double min_distance_mm,
                                                   double false_alarm = 1e-3);

} // namespace bregma::registration
