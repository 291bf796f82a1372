// Points and curves: landmarks and operator-marked polylines on two images become pairs for a thin-plate spline.
//
// [thesis, section 3.2.3]. Both curves of a pair are divided at equal arc length into the same number of points, both
// ends included. The n-th point of one corresponds to the n-th of the other. The seven steps printed there contain an
// inverted comparison: step 5 generates a point where d <= dist, and step 6 accumulates where "d < dist". Both would
// hold at once, and a segment shorter than the interval would never be passed. Here a point is generated where
// d <= dist, and the next vertex is taken where dist < d. The interval is total / (count - 1), not total / count, so
// that the last point is the end of the curve.
//
// Units: mm. Pure, reentrant, allocates.
#pragma once

#include <span>
#include <string>

#include <tl/expected.hpp>

#include "algorithms/geometry/points.hpp"

namespace bregma::registration {

[[nodiscard]] double arc_length_mm(const Eigen::Ref<const Eigen::MatrixXd> &vertices) noexcept; // one column per vertex

// `count` points at equal arc length. closed: the last vertex is joined to the first, and the points start at the first
// without repeating it. Repeated vertices are skipped. Otherwise a sentence: fewer than two vertices or points, no
// length, or numbers that are not finite.
template <int D>
[[nodiscard]] tl::expected<geometry::Points<D>, std::string> subdivide(const geometry::Points<D> &vertices_mm,
                                                                       int count, bool closed = false);

template <int D> struct CurvePair {
  geometry::Points<D> reference_mm, floating_mm; // polylines, marked in the same direction
  int count = 20;                                // points on each
  bool closed = false;
};

template <int D> struct PointSets { // column i of one corresponds to column i of the other
  geometry::Points<D> reference_mm, floating_mm;
};

// Landmarks first, then the points of each curve. A curve often begins at a landmark: a pair that repeats an earlier
// one within same_mm on the reference side is left out. Otherwise a sentence: the numbers of landmarks differ, or a
// curve cannot be subdivided (named by index).
template <int D>
[[nodiscard]] tl::expected<PointSets<D>, std::string> join(const PointSets<D> &landmarks,
                                                           std::span<const CurvePair<D>> curves, double same_mm = 1e-3);

} // namespace bregma::registration
