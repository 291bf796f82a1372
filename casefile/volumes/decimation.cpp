#include "casefile/volumes/decimation.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <iterator>
#include <queue>
#include <tuple>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

namespace bregma::casefile {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Weight of a point's own position against the planes of its triangles: it keeps the shape of triangles in plane
// regions and makes the best position unique.
constexpr double kPointWeight = 1e-3;
constexpr double kMinCosine = 0.2; // between the normals of a triangle before and after a collapse

// Sum of squared distances from planes, weighted by area: x^T A x - 2 b^T x + c.
struct Quadric {
  Matrix3d A = Matrix3d::Zero();
  Vector3d b = Vector3d::Zero();
  double c = 0.0;

  Quadric &operator+=(const Quadric &other) {
    A += other.A;
    b += other.b;
    c += other.c;
    return *this;
  }
  [[nodiscard]] double at(const Vector3d &x) const { return x.dot(A * x) - 2.0 * b.dot(x) + c; }
};

Quadric plane_quadric(const Vector3d &p, const Vector3d &unit_normal, double weight) {
  const double d = unit_normal.dot(p);
  return {weight * unit_normal * unit_normal.transpose(), weight * d * unit_normal, weight * d * d};
}

Quadric point_quadric(const Vector3d &p, double weight) {
  return {weight * Matrix3d::Identity(), weight * p, weight * p.squaredNorm()};
}

struct Collapse {
  double cost = 0.0;
  int a = 0, b = 0;
  unsigned version = 0; // of both ends, when it was computed
  friend bool operator<(const Collapse &x, const Collapse &y) {
    return std::tie(x.cost, x.a, x.b) > std::tie(y.cost, y.a, y.b); // the cheapest first, ties always alike
  }
};

class Decimation {
public:
  explicit Decimation(const surface::TriangleMesh &mesh)
      : points_(mesh.vertices_mm), triangles_(mesh.triangles), alive_(mesh.triangles.size(), true),
        around_(points_.size()), quadrics_(points_.size()), versions_(points_.size(), 0),
        left_(static_cast<int>(points_.size())) {
    // Relative to a point of the mesh, where the sums cancel least.
    origin_ = points_.empty() ? Vector3d::Zero() : points_.front();
    for (Vector3d &point : points_) {
      point -= origin_;
    }
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      const Vector3d normal = normal_of(triangles_[t]);
      const double area = 0.5 * normal.norm();
      for (const int corner : triangles_[t]) {
        const auto v = static_cast<std::size_t>(corner);
        around_[v].push_back(static_cast<int>(t));
        if (area > 0.0) {
          quadrics_[v] += plane_quadric(points_[v], normal.normalized(), area / 3.0);
          quadrics_[v] += point_quadric(points_[v], kPointWeight * area / 3.0);
        }
      }
    }
  }

  surface::TriangleMesh run(int vertices) {
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      for (int corner = 0; corner < 3; ++corner) {
        const int a = triangles_[t][corner];
        const int b = triangles_[t][(corner + 1) % 3];
        if (a < b) { // the neighbour has the edge the other way round
          propose(a, b);
        }
      }
    }
    while (left_ > vertices && !queue_.empty()) {
      const Collapse next = queue_.top();
      queue_.pop();
      if (next.version == versions_[index(next.a)] + versions_[index(next.b)] && !around_[index(next.a)].empty() &&
          !around_[index(next.b)].empty()) {
        collapse(next.a, next.b);
      }
    }
    return result();
  }

private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  [[nodiscard]] Vector3d normal_of(const Eigen::Vector3i &t) const {
    return (points_[index(t[1])] - points_[index(t[0])]).cross(points_[index(t[2])] - points_[index(t[0])]);
  }

  // The best position for the vertex that replaces both.
  [[nodiscard]] std::pair<double, Vector3d> best(int a, int b) const {
    Quadric sum = quadrics_[index(a)];
    sum += quadrics_[index(b)];
    const Vector3d middle = 0.5 * (points_[index(a)] + points_[index(b)]);
    const Vector3d found = sum.A.ldlt().solve(sum.b);
    // A solution far off comes from planes that are almost parallel.
    const double length = (points_[index(a)] - points_[index(b)]).norm();
    const Vector3d at = found.allFinite() && (found - middle).norm() < 2.0 * length ? found : middle;
    return {sum.at(at), at};
  }

  void propose(int a, int b) { queue_.push({best(a, b).first, a, b, versions_[index(a)] + versions_[index(b)]}); }

  // The vertices that share a triangle with v, sorted.
  [[nodiscard]] std::vector<int> neighbours(int v) const {
    std::vector<int> out;
    for (const int t : around_[index(v)]) {
      for (const int corner : triangles_[index(t)]) {
        if (corner != v) {
          out.push_back(corner);
        }
      }
    }
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }

  [[nodiscard]] bool keeps_topology(const std::vector<int> &near_a, const std::vector<int> &near_b) const {
    std::vector<int> common;
    std::set_intersection(near_a.begin(), near_a.end(), near_b.begin(), near_b.end(), std::back_inserter(common));
    const bool tetrahedron = near_a.size() == 3 && near_b.size() == 3;
    return common.size() == 2 && !tetrahedron;
  }

  // Whether no triangle of v turns over or collapses to a line when v moves.
  [[nodiscard]] bool keeps_sides(int v, int other, const Vector3d &to) const {
    return std::all_of(around_[index(v)].begin(), around_[index(v)].end(), [&](int t) {
      const Eigen::Vector3i &corners = triangles_[index(t)];
      if ((corners.array() == other).any()) {
        return true; // it vanishes
      }
      std::array<Vector3d, 3> p;
      for (int i = 0; i < 3; ++i) {
        p[index(i)] = corners[i] == v ? to : points_[index(corners[i])];
      }
      const Vector3d before = normal_of(corners);
      const Vector3d after = (p[1] - p[0]).cross(p[2] - p[0]);
      const double longest =
          std::max({(p[1] - p[0]).squaredNorm(), (p[2] - p[1]).squaredNorm(), (p[0] - p[2]).squaredNorm()});
      return after.norm() > 1e-3 * longest &&
             (before.norm() <= 0.0 || after.dot(before) > kMinCosine * after.norm() * before.norm());
    });
  }

  // b becomes a, at its best position.
  void collapse(int a, int b) {
    const Vector3d to = best(a, b).second;
    const std::vector<int> near_a = neighbours(a);
    const std::vector<int> near_b = neighbours(b);
    if (!keeps_topology(near_a, near_b) || !keeps_sides(a, b, to) || !keeps_sides(b, a, to)) {
      return; // proposed again when a neighbour has moved
    }
    for (const int t : around_[index(b)]) {
      Eigen::Vector3i &corners = triangles_[index(t)];
      if ((corners.array() == a).any()) {
        alive_[index(t)] = false;
        for (const int corner : corners) {
          if (corner != b) {
            std::erase(around_[index(corner)], t);
          }
        }
        continue;
      }
      std::replace(corners.begin(), corners.end(), b, a);
      around_[index(a)].push_back(t);
    }
    around_[index(b)].clear();
    points_[index(a)] = to;
    quadrics_[index(a)] += quadrics_[index(b)];
    --left_;
    ++versions_[index(a)];
    for (const int v : neighbours(a)) {
      propose(std::min(a, v), std::max(a, v));
    }
  }

  [[nodiscard]] surface::TriangleMesh result() const {
    surface::TriangleMesh out;
    std::vector<int> renamed(points_.size(), -1);
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      if (!alive_[t]) {
        continue;
      }
      Eigen::Vector3i corners = triangles_[t];
      for (int &corner : corners) {
        int &name = renamed[index(corner)];
        if (name < 0) {
          name = static_cast<int>(out.vertices_mm.size());
          out.vertices_mm.emplace_back(points_[index(corner)] + origin_);
        }
        corner = name;
      }
      out.triangles.push_back(corners);
    }
    return out;
  }

  std::vector<Vector3d> points_;
  std::vector<Eigen::Vector3i> triangles_;
  std::vector<bool> alive_;
  std::vector<std::vector<int>> around_; // triangles of each vertex
  std::vector<Quadric> quadrics_;
  std::vector<unsigned> versions_; // counts the moves of a vertex
  std::priority_queue<Collapse> queue_;
  Vector3d origin_ = Vector3d::Zero();
  int left_;
};

} // namespace

surface::TriangleMesh decimated(const surface::TriangleMesh &mesh, int vertices) {
  return Decimation(mesh).run(vertices);
}

} // namespace bregma::casefile
