// Paired points of which some may be wrong: touched at another landmark, slipped, swapped.
//
// Every triple of pairs proposes a pose; the pose that most pairs agree with, each within the distance that its own
// covariance allows at a false-alarm rate, is taken (consensus after Fischler & Bolles 1981, over all triples instead
// of random ones, so that the answer is always the same). fit_paired then refines it over those that agree, pairs are
// judged again by what the others predict for them, and this goes on until none changes. Up to 64 pairs; beyond
// kMaxTriples triples an even share of them is tried. Of four pairs three are enough where no other three agree too.
//
// Units: mm. Does not allocate or throw; reentrant.
#pragma once

#include "algorithms/registration/points/paired_points.hpp"

namespace bregma::registration {

inline constexpr int kMaxTriples = 5000;

struct RobustOptions {
  double false_alarm = 0.01; // chance that any one of all good pairs is called an outlier
};

struct RobustFit {
  // Enough pairs agree (more than half of all, and at least four, so that the agreement says something; or the only
  // three of four that do) and the refined estimate converged. Otherwise `fit` is of the most that agreed, or of
  // nothing (not converged).
  bool found = false;
  PairedFit fit; // over the inliers; fit.fiducials are in the order of all pairs, the residuals of outliers included
  std::array<bool, kMaxFiducials> inlier{}; // the first `count`
  // Chance of lying so far from what the inliers predict, were the pair as good as stated; before any correction for
  // the number of pairs.
  std::array<double, kMaxFiducials> p_value{};
  int count = 0;
  int outliers = 0;
};

[[nodiscard]] RobustFit fit_paired_robust(std::span<const PointPair> pairs, const RobustOptions &options = {}) noexcept;

// "Is this FRE too large for this FLE?" For an isotropic error of fle_rms_mm (root mean square distance) in each of N
// fiducials, N FRE^2 / (FLE^2 / 3) is chi-square with 3 N - 6 degrees of freedom to first order (Sibson 1979). The
// chance of an FRE so large; NaN below three fiducials. For stated covariances fit_paired gives the same as p_value.
[[nodiscard]] double fre_p_value(int fiducials, double fre_rms_mm, double fle_rms_mm) noexcept;

} // namespace bregma::registration
