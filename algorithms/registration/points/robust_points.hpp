// Paired points that may contain wrong ones: touched at another landmark, slipped, swapped.
//
// Every triple of pairs proposes a pose. The pose with the largest consensus is taken: a pair agrees within the
// distance that its own covariance allows at a false-alarm rate [Fischler 1981]. All triples are tried instead of
// random ones, so that the answer is always the same. fit_paired then refines the pose over the pairs that agree. Pairs
// are tested again against what the others predict for them, until none changes. Up to kMaxPairs pairs; beyond
// kMaxTriples triples, an even selection of them is tried. Of four pairs three suffice where no other three agree too.
//
// Units: mm. Does not allocate or throw; reentrant.
#pragma once

#include "algorithms/registration/points/paired_points.hpp"

namespace bregma::registration {

inline constexpr int kMaxTriples = 5000;

struct RobustOptions {
  double false_alarm = 0.01; // probability that any of all good pairs is called an outlier
};

struct RobustFit {
  // Enough pairs agree (more than half of all and at least four, so that the agreement is significant; or the only
  // three of four that do), and the refined estimate converged. Otherwise `fit` is that of the largest consensus, or
  // empty (not converged).
  bool found = false;
  PairedFit fit; // over the inliers; fit.fiducials are in the order of all pairs, the residuals of outliers included
  std::array<bool, kMaxPairs> inlier{}; // the first `count`
  // Probability of at least this distance from the inliers' prediction if the stated errors hold; not corrected for the
  // number of pairs.
  std::array<double, kMaxPairs> p_value{};
  int count = 0;
  int outliers = 0;
};

[[nodiscard]] RobustFit fit_paired_robust(std::span<const PointPair> pairs, const RobustOptions &options = {}) noexcept;

// Tests whether an FRE is too large for an FLE. For an isotropic error of fle_rms_mm (root mean square distance) in
// each of N fiducials, N FRE^2 / (FLE^2 / 3) is chi-square with 3 N - 6 degrees of freedom to first order [Sibson
// 1979]. Returns the probability of an FRE at least this large; NaN below three fiducials. For stated covariances
// fit_paired gives the same as p_value.
[[nodiscard]] double fre_p_value(int fiducials, double fre_rms_mm, double fle_rms_mm) noexcept;

} // namespace bregma::registration
