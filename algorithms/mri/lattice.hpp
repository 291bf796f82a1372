// The regular arrangement of a phantom's control points: directions and distances from a point to its neighbours.
//
// Nothing is known about the phantom but that most points have neighbours in the same directions at the same distances,
// up to the distortion. Units: mm. Pure functions, any thread; O(N^2) time.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "algorithms/geometry/points.hpp"

namespace bregma::mri {

// Distance of each point from its nearest neighbour.
[[nodiscard]] std::vector<double> nearest_distances(const geometry::Points3 &points_mm);
[[nodiscard]] double median(std::vector<double> values); // 0 without values

struct LatticeSteps {
  geometry::Points3 steps_mm; // at most three, the most frequent first, at least 50 degrees apart
  double spacing_mm = 0.0;    // median distance of nearest neighbours
};
// Most frequent displacements between near neighbours, averaged over the points. spacing_mm: of a known lattice, where
// points may be doubled; 0: the median distance of nearest neighbours.
[[nodiscard]] LatticeSteps lattice_steps(const geometry::Points3 &points_mm, double spacing_mm = 0.0);

// RMS distance of the points from the straight, evenly spaced lattice that fits them best, up to shear: how far
// something has bent them. Nothing where they are no lattice, or bent so far that a fifth of them lies nearer to the
// middle between places than to one.
[[nodiscard]] std::optional<double> bend_mm(const geometry::Points3 &points_mm);

// Every other point, as section VI-A of [Tuna 2022] holds points out "for each grid". On a lattice, neighbours along
// its steps are in different halves, also where points are missing; without one, neighbours among the columns.
struct Halves {
  std::vector<Eigen::Index> used, held_out; // columns, in their order; the first column is used
};
[[nodiscard]] Halves every_other(const geometry::Points3 &points_mm);

} // namespace bregma::mri
