#include "algorithms/registration/splines/curves.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::registration {

using geometry::Points;

double arc_length_mm(const Eigen::Ref<const Eigen::MatrixXd> &vertices) noexcept {
  double sum = 0.0;
  for (Eigen::Index i = 1; i < vertices.cols(); ++i) {
    sum += (vertices.col(i) - vertices.col(i - 1)).norm();
  }
  return sum;
}

template <int D> tl::expected<Points<D>, std::string> subdivide(const Points<D> &vertices_mm, int count, bool closed) {
  if (vertices_mm.cols() < 2 || count < 2) {
    return tl::unexpected(std::string("a curve needs two vertices and two points"));
  }
  if (!vertices_mm.allFinite()) {
    return tl::unexpected(std::string("a vertex of the curve is not a number"));
  }
  Points<D> path = vertices_mm;
  if (closed) {
    path.conservativeResize(Eigen::NoChange, path.cols() + 1);
    path.col(path.cols() - 1) = path.col(0);
  }
  const double total = arc_length_mm(path);
  if (!(total > 0.0)) {
    return tl::unexpected(std::string("the curve has no length"));
  }
  const double interval = total / (closed ? count : count - 1);
  Points<D> out(D, count);
  out.col(0) = path.col(0);
  double behind = 0.0; // arc length at the first vertex of the segment
  Eigen::Index segment = 0;
  for (int i = 1; i < count; ++i) {
    const double at = interval * i;
    double length = (path.col(segment + 1) - path.col(segment)).norm();
    while (behind + length < at && segment + 2 < path.cols()) {
      behind += length;
      ++segment;
      length = (path.col(segment + 1) - path.col(segment)).norm();
    }
    const double fraction = length > 0.0 ? std::min((at - behind) / length, 1.0) : 1.0;
    out.col(i) = path.col(segment) + fraction * (path.col(segment + 1) - path.col(segment));
  }
  return out;
}

template <int D>
tl::expected<PointSets<D>, std::string> join(const PointSets<D> &landmarks, std::span<const CurvePair<D>> curves,
                                             double same_mm) {
  if (landmarks.reference_mm.cols() != landmarks.floating_mm.cols()) {
    return tl::unexpected(std::to_string(landmarks.reference_mm.cols()) + " landmarks on the reference but " +
                          std::to_string(landmarks.floating_mm.cols()) + " on the floating image");
  }
  Eigen::Index capacity = landmarks.reference_mm.cols();
  for (const CurvePair<D> &curve : curves) {
    capacity += std::max(curve.count, 0);
  }
  PointSets<D> out{Points<D>(D, capacity), Points<D>(D, capacity)};
  Eigen::Index used = 0;
  const auto add = [&](const Points<D> &reference, const Points<D> &floating) {
    for (Eigen::Index i = 0; i < reference.cols(); ++i) {
      const auto distances = (out.reference_mm.leftCols(used).colwise() - reference.col(i)).colwise().norm();
      if (used == 0 || distances.minCoeff() > same_mm) {
        out.reference_mm.col(used) = reference.col(i);
        out.floating_mm.col(used++) = floating.col(i);
      }
    }
  };
  add(landmarks.reference_mm, landmarks.floating_mm);
  for (std::size_t c = 0; c < curves.size(); ++c) {
    const auto reference = subdivide<D>(curves[c].reference_mm, curves[c].count, curves[c].closed);
    const auto floating = subdivide<D>(curves[c].floating_mm, curves[c].count, curves[c].closed);
    if (!reference || !floating) {
      return tl::unexpected("curve " + std::to_string(c) + (reference ? ", floating: " : ", reference: ") +
                            (reference ? floating.error() : reference.error()));
    }
    add(*reference, *floating);
  }
  out.reference_mm.conservativeResize(Eigen::NoChange, used);
  out.floating_mm.conservativeResize(Eigen::NoChange, used);
  return out;
}

template tl::expected<Points<2>, std::string> subdivide<2>(const Points<2> &, int, bool);
template tl::expected<Points<3>, std::string> subdivide<3>(const Points<3> &, int, bool);
template tl::expected<PointSets<2>, std::string> join<2>(const PointSets<2> &, std::span<const CurvePair<2>>, double);
template tl::expected<PointSets<3>, std::string> join<3>(const PointSets<3> &, std::span<const CurvePair<3>>, double);

} // namespace bregma::registration
