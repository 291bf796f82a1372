#include "algorithms/tissue_plane/plane_smoothing.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "algorithms/tissue_plane/plane_mesher.hpp"

namespace bregma::tissue_plane {
namespace {

// 1 for an equilateral triangle, 0 for a flat one, negative for an inverted one [Bank 1997].
double quality(const Eigen::Vector2d &a, const Eigen::Vector2d &b, const Eigen::Vector2d &c) {
  const double twice_area = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
  return 2.0 * std::sqrt(3.0) * twice_area / ((b - a).squaredNorm() + (c - b).squaredNorm() + (a - c).squaredNorm());
}

Eigen::Vector2d closest_on(const Loop &loop, const Eigen::Vector2d &p, double &best) {
  Eigen::Vector2d out = p;
  for (std::size_t i = 0, j = loop.size() - 1; i < loop.size(); j = i++) {
    const Eigen::Vector2d along = loop[i] - loop[j];
    const double length = along.squaredNorm();
    const double t = length > 0.0 ? std::clamp((p - loop[j]).dot(along) / length, 0.0, 1.0) : 0.0;
    const Eigen::Vector2d q = loop[j] + t * along;
    if (const double distance = (p - q).squaredNorm(); distance < best) {
      best = distance;
      out = q;
    }
  }
  return out;
}

Eigen::Vector2d closest_on(const Outline &outline, const Eigen::Vector2d &p) {
  double best = INFINITY;
  Eigen::Vector2d out = closest_on(outline.outer, p, best);
  for (const Loop &hole : outline.holes) {
    const double before = best;
    const Eigen::Vector2d q = closest_on(hole, p, best);
    if (best < before) {
      out = q;
    }
  }
  return out;
}

class Smoothing {
public:
  Smoothing(PlaneMesh &mesh, const Outline &outline, const std::optional<double> &cut_y_mm)
      : mesh_(mesh), outline_(outline), cut_y_(cut_y_mm), around_(mesh.nodes_mm.size()),
        beside_(mesh.nodes_mm.size(), {-1, -1}) {
    for (std::size_t e = 0; e < mesh.triangles.size(); ++e) {
      for (const int n : mesh.triangles[e]) {
        around_[static_cast<std::size_t>(n)].push_back(e);
      }
    }
    for (const Eigen::Vector2i &edge : boundary_of(mesh)) {
      beside_[static_cast<std::size_t>(edge[0])][1] = edge[1];
      beside_[static_cast<std::size_t>(edge[1])][0] = edge[0];
    }
  }

  void sweep() {
    for (std::size_t n = 0; n < mesh_.nodes_mm.size(); ++n) {
      const bool on_boundary = beside_[n][0] >= 0;
      const bool on_line = cut_y_ && std::abs(mesh_.nodes_mm[n].y() - *cut_y_) < kOnLine_mm;
      if (on_boundary && on_line) {
        continue; // where the line crosses the boundary
      }
      Eigen::Vector2d target = on_boundary ? middle_of_neighbours(n) : centroid(n);
      if (on_line) {
        target.y() = *cut_y_;
      }
      move(n, target, on_boundary);
    }
  }

private:
  static constexpr double kOnLine_mm = 1e-6;
  static constexpr int kHalvings = 3;

  [[nodiscard]] const Eigen::Vector2d &at(int n) const { return mesh_.nodes_mm[static_cast<std::size_t>(n)]; }

  [[nodiscard]] Eigen::Vector2d middle_of_neighbours(std::size_t n) const {
    return 0.5 * (at(beside_[n][0]) + at(beside_[n][1]));
  }

  [[nodiscard]] Eigen::Vector2d centroid(std::size_t n) const {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    double weight = 0.0;
    for (const std::size_t e : around_[n]) {
      const Eigen::Vector3i &t = mesh_.triangles[e];
      const Eigen::Vector2d ab = at(t[1]) - at(t[0]);
      const Eigen::Vector2d ac = at(t[2]) - at(t[0]);
      const double area = ab.x() * ac.y() - ab.y() * ac.x();
      sum += area * (at(t[0]) + at(t[1]) + at(t[2])) / 3.0;
      weight += area;
    }
    return sum / weight;
  }

  [[nodiscard]] double worst(std::size_t n) const {
    double out = 1.0;
    for (const std::size_t e : around_[n]) {
      const Eigen::Vector3i &t = mesh_.triangles[e];
      out = std::min(out, quality(at(t[0]), at(t[1]), at(t[2])));
    }
    return out;
  }

  void move(std::size_t n, const Eigen::Vector2d &target, bool on_boundary) {
    const Eigen::Vector2d from = mesh_.nodes_mm[n];
    const double before = worst(n);
    double fraction = 1.0;
    for (int k = 0; k < kHalvings; ++k, fraction *= 0.5) {
      const Eigen::Vector2d to = from + fraction * (target - from);
      mesh_.nodes_mm[n] = on_boundary ? closest_on(outline_, to) : to;
      if (worst(n) > before) {
        return;
      }
    }
    mesh_.nodes_mm[n] = from;
  }

  PlaneMesh &mesh_;
  const Outline &outline_;
  const std::optional<double> &cut_y_;
  std::vector<std::vector<std::size_t>> around_; // triangles of a node
  std::vector<std::array<int, 2>> beside_;       // neighbours along the boundary; -1 within
};

} // namespace

void smooth(PlaneMesh &mesh, const Outline &outline, const std::optional<double> &cut_y_mm, int sweeps) {
  Smoothing smoothing(mesh, outline, cut_y_mm);
  for (int k = 0; k < sweeps; ++k) {
    smoothing.sweep();
  }
}

} // namespace bregma::tissue_plane
