// Which control point of one image of a phantom is which of another.
//
// Coherent point drift places the reference (CT) on the imaged points (MR) rigidly [Tuna 2022, section III-C]. It goes
// on with a smooth distortion, solid harmonics of rising degree, so that a distortion of half a spacing at the edge
// does not end at the wrong neighbour. Mutual nearest neighbours are then pairs, and a robust fit of the same harmonics
// finds those that do not belong.
//
// A lattice also fits one cell off, or turned by 90 degrees. Both are tried. Another placement that explains nearly as
// many points makes the answer ambiguous: the points do not decide it. Where headers state how the phantom lay
// (same_orientation), turned placements are excluded.
//
// Every point without a partner is listed with its reason. Units: mm, frames with the isocentre as origin for the
// imaged points. Pure functions, any thread; tens of milliseconds for some hundred points.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "algorithms/geometry/points.hpp"
#include "algorithms/geometry/rigid3.hpp"

namespace bregma::mri {

inline constexpr int kFewestMatched = 12; // points of a list

struct MatchOptions {
  bool same_orientation = true;   // the frames' axes are those of the phantom in both images, up to max_rotation_rad
  double max_rotation_rad = 0.70; // 40 degrees
  int max_degree = 7;             // of the smooth distortion
  double max_residual_mm = 0.0;   // of a pair from the smooth distortion; 0: 0.13 of the spacing
  double ambiguous_share = 0.02;  // of the pairs, or three: a placement that is worse by less is an alternative
};

enum class MatchOutcome {
  kMatched,
  kAmbiguous,   // another placement explains the points as well
  kTurned,      // same_orientation, but the placement that fits is turned by more
  kNoMatch,     // fewer than half of the points of the smaller set find a partner
  kTooFewPoints // fewer than 12 on a side, or numbers that are not finite
};
[[nodiscard]] const char *name(MatchOutcome outcome) noexcept;

enum class UnmatchedReason {
  kIsolated, // no neighbour at the lattice's distance
  kDoubled,  // another point of the same set, close by, fits better
  kOffField, // its partner is off the smooth distortion
  kNoPartner
};
[[nodiscard]] const char *name(UnmatchedReason reason) noexcept;

struct MatchedPair {
  Eigen::Index reference = 0, imaged = 0;
  double residual_mm = 0.0; // from the smooth distortion
};
struct UnmatchedPoint {
  Eigen::Index index = 0;
  UnmatchedReason reason = UnmatchedReason::kNoPartner;
  double distance_mm = 0.0; // to the nearest point that decides the reason
};

struct MatchResult {
  MatchOutcome outcome = MatchOutcome::kTooFewPoints;
  // Rigid, by least squares over the pairs: the reference in the frame of the imaged points.
  geometry::Rigid3<geometry::frame::Target, geometry::frame::Source> T_imaged_reference;
  std::vector<MatchedPair> pairs; // by reference index
  std::vector<UnmatchedPoint> reference_unmatched, imaged_unmatched;
  double rms_residual_mm = 0.0;
  struct Alternative {
    double rotation_rad = 0.0, shift_mm = 0.0; // relative to T_imaged_reference
    Eigen::Index pairs = 0;
  };
  std::optional<Alternative> alternative; // the best other placement, if ambiguous

  [[nodiscard]] geometry::Points3 reference_points(const geometry::Points3 &reference_mm) const; // in the imaged frame
  [[nodiscard]] geometry::Points3 imaged_points(const geometry::Points3 &imaged_mm) const;
};

[[nodiscard]] MatchResult match_points(const geometry::Points3 &reference_mm, const geometry::Points3 &imaged_mm,
                                       const MatchOptions &options = {});

// Pairs that a given list (column i of both) has wrong: farther than max_residual_mm (0: as above) from a robust
// smooth distortion of all pairs. Empty as well if there are fewer than 12 pairs or numbers that are not finite.
[[nodiscard]] std::vector<MatchedPair> wrong_pairs(const geometry::Points3 &reference_mm,
                                                   const geometry::Points3 &imaged_mm, double max_residual_mm = 0.0);

} // namespace bregma::mri
