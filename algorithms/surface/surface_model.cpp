#include "algorithms/surface/surface_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include <Eigen/Geometry>

namespace bregma::surface {

using Eigen::Vector3d;

namespace {

constexpr std::uint32_t kLeafSize = 4;

void check(const TriangleMesh &mesh) {
  if (mesh.triangles.empty()) {
    throw std::invalid_argument("the surface has no triangles");
  }
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    if (!mesh.vertices_mm[i].allFinite()) {
      throw std::invalid_argument("vertex " + std::to_string(i) + " of the surface is not finite");
    }
  }
  const auto count = static_cast<int>(mesh.vertices_mm.size());
  double area = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Eigen::Vector3i &t = mesh.triangles[i];
    for (int k = 0; k < 3; ++k) {
      if (t[k] < 0 || t[k] >= count) {
        throw std::invalid_argument("triangle " + std::to_string(i) + " of the surface names vertex " +
                                    std::to_string(t[k]) + ", but there are " + std::to_string(count));
      }
    }
    const auto vertex = [&](int k) -> const Vector3d & { return mesh.vertices_mm[static_cast<std::size_t>(t[k])]; };
    area += (vertex(1) - vertex(0)).cross(vertex(2) - vertex(0)).norm();
  }
  if (!(area > 0.0)) {
    throw std::invalid_argument("the triangles of the surface have no area");
  }
}

// Slab test. inverse: reciprocals of the segment's components, infinite where it is parallel to a slab.
bool segment_meets_box(const Vector3d &low, const Vector3d &high, const Vector3d &from,
                       const Vector3d &inverse) noexcept {
  double enter = 0.0;
  double leave = 1.0;
  for (int k = 0; k < 3; ++k) {
    if (std::isinf(inverse[k])) {
      if (from[k] < low[k] || from[k] > high[k]) {
        return false;
      }
      continue;
    }
    const double a = (low[k] - from[k]) * inverse[k];
    const double b = (high[k] - from[k]) * inverse[k];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave * (1.0 + 1e-12);
}

// [Moeller 1997], without culling.
bool segment_meets_triangle(const Vector3d &a, const Vector3d &b, const Vector3d &c, const Vector3d &from,
                            const Vector3d &along) noexcept {
  const Vector3d ab = b - a;
  const Vector3d ac = c - a;
  const Vector3d h = along.cross(ac);
  const double det = ab.dot(h);
  if (det == 0.0) {
    return false;
  }
  const Vector3d s = (from - a) / det;
  const double u = s.dot(h);
  const Vector3d q = s.cross(ab);
  const double v = along.dot(q);
  const double t = ac.dot(q);
  constexpr double kSlack = 1e-12; // so that a segment through an edge does not slip between two triangles
  return u >= -kSlack && v >= -kSlack && u + v <= 1.0 + kSlack && t >= 0.0 && t <= 1.0;
}

} // namespace

SurfaceModel::SurfaceModel(const TriangleMesh &mesh) {
  check(mesh);
  std::vector<std::uint32_t> order(mesh.triangles.size());
  std::iota(order.begin(), order.end(), 0U);
  build(order, mesh);
  build_normals(mesh);
}

void SurfaceModel::build(std::vector<std::uint32_t> &order, const TriangleMesh &mesh) {
  const auto vertex = [&](std::uint32_t triangle, int k) -> const Vector3d & {
    return mesh.vertices_mm[static_cast<std::size_t>(mesh.triangles[triangle][k])];
  };
  std::vector<Vector3d> middle(order.size());
  for (const std::uint32_t t : order) {
    middle[t] = (vertex(t, 0) + vertex(t, 1) + vertex(t, 2)) / 3.0;
  }
  const auto split = [&](const auto &self, std::uint32_t begin, std::uint32_t end) -> void {
    const std::size_t index = nodes_.size();
    Node node{Vector3d::Constant(std::numeric_limits<double>::infinity()),
              Vector3d::Constant(-std::numeric_limits<double>::infinity()), begin, end - begin};
    for (std::uint32_t i = begin; i < end; ++i) {
      for (int k = 0; k < 3; ++k) {
        node.low = node.low.cwiseMin(vertex(order[i], k));
        node.high = node.high.cwiseMax(vertex(order[i], k));
      }
    }
    nodes_.push_back(node);
    if (end - begin <= kLeafSize) {
      return;
    }
    Eigen::Index side = 0;
    (node.high - node.low).maxCoeff(&side);
    const std::uint32_t half = begin + (end - begin) / 2;
    std::nth_element(order.begin() + begin, order.begin() + half, order.begin() + end,
                     [&](std::uint32_t a, std::uint32_t b) { return middle[a][side] < middle[b][side]; });
    self(self, begin, half);
    nodes_[index].first = static_cast<std::uint32_t>(nodes_.size());
    nodes_[index].count = 0;
    self(self, half, end);
  };
  split(split, 0, static_cast<std::uint32_t>(order.size()));
  low_ = nodes_.front().low;
  high_ = nodes_.front().high;

  slot_.resize(order.size());
  for (std::uint32_t s = 0; s < order.size(); ++s) {
    corners_.push_back({vertex(order[s], 0), vertex(order[s], 1), vertex(order[s], 2)});
    mesh_index_.push_back(static_cast<int>(order[s]));
    slot_[order[s]] = s;
  }
}

void SurfaceModel::build_normals(const TriangleMesh &mesh) {
  struct Edge {
    Vector3d normal = Vector3d::Zero();
    int forward = 0;
    int backward = 0;
  };
  std::map<std::pair<int, int>, Edge> edges;
  std::vector<Vector3d> at_vertex(mesh.vertices_mm.size(), Vector3d::Zero());
  std::vector<Vector3d> face(mesh.triangles.size());
  for (std::size_t i = 0; i < face.size(); ++i) {
    const Eigen::Vector3i &t = mesh.triangles[i];
    const Corners &c = corners_[slot_[i]];
    face[i] = (c.b - c.a).cross(c.c - c.a).normalized(); // zero for a triangle without area
    const std::array<Vector3d, 3> corner{c.a, c.b, c.c};
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3d next = corner[(k + 1) % 3] - corner[k];
      const Vector3d last = corner[(k + 2) % 3] - corner[k];
      at_vertex[static_cast<std::size_t>(t[static_cast<int>(k)])] +=
          std::atan2(next.cross(last).norm(), next.dot(last)) * face[i];
      const int from = t[static_cast<int>(k)];
      const int to = t[static_cast<int>((k + 1) % 3)];
      Edge &edge = edges[std::minmax(from, to)];
      edge.normal += face[i];
      ++(from < to ? edge.forward : edge.backward);
    }
  }
  closed_ = std::all_of(edges.begin(), edges.end(),
                        [](const auto &entry) { return entry.second.forward == 1 && entry.second.backward == 1; });
  for (const int index : mesh_index_) {
    const auto i = static_cast<std::size_t>(index);
    const Eigen::Vector3i &t = mesh.triangles[i];
    normals_.push_back(face[i]);
    for (int k = 0; k < 3; ++k) {
      normals_.push_back(edges[std::minmax(t[k], t[(k + 1) % 3])].normal.normalized());
    }
    for (int k = 0; k < 3; ++k) {
      normals_.push_back(at_vertex[static_cast<std::size_t>(t[k])].normalized());
    }
  }
}

// [Ericson 2005, section 5.1.5]: by the Voronoi regions of the corners, edges and the face. A triangle without area,
// as at the poles of a surface of quads, is its longest edge.
SurfaceModel::Closest SurfaceModel::closest_on_triangle(const Corners &t, const Vector3d &p) noexcept {
  const Vector3d ab = t.b - t.a;
  const Vector3d ac = t.c - t.a;
  const Vector3d ap = p - t.a;
  const double d1 = ab.dot(ap);
  const double d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) {
    return {t.a, kVertexA};
  }
  const Vector3d bp = p - t.b;
  const double d3 = ab.dot(bp);
  const double d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) {
    return {t.b, kVertexB};
  }
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3) { // else a and b coincide
    return {t.a + d1 / (d1 - d3) * ab, kEdgeAB};
  }
  const Vector3d cp = p - t.c;
  const double d5 = ab.dot(cp);
  const double d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) {
    return {t.c, kVertexC};
  }
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
    return {t.a + d2 / (d2 - d6) * ac, kEdgeCA};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
    return {t.b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (t.c - t.b), kEdgeBC};
  }
  const double sum = va + vb + vc;
  if (!(sum > 0.0)) { // by rounding, in a sliver
    return {t.a, kVertexA};
  }
  const double scale = 1.0 / sum;
  return {t.a + vb * scale * ab + vc * scale * ac, kFace};
}

SurfacePoint SurfaceModel::closest(const Vector3d &point_mm) const noexcept { return closest(point_mm, -1); }

SurfacePoint SurfaceModel::closest(const Vector3d &point_mm, int start_triangle) const noexcept {
  double best = std::numeric_limits<double>::infinity();
  std::uint32_t best_slot = 0;
  Closest found{Vector3d::Zero(), kFace};
  const auto try_slot = [&](std::uint32_t slot) {
    const Closest candidate = closest_on_triangle(corners_[slot], point_mm);
    const double d2 = (candidate.point - point_mm).squaredNorm();
    if (d2 < best) {
      best = d2;
      best_slot = slot;
      found = candidate;
    }
  };
  if (start_triangle >= 0 && static_cast<std::size_t>(start_triangle) < slot_.size()) {
    try_slot(slot_[static_cast<std::size_t>(start_triangle)]);
  }

  struct Waiting {
    std::uint32_t node;
    double squared;
  };
  std::array<Waiting, kMaxDepth> stack;
  int top = 0;
  stack[0] = {0, 0.0};
  while (top >= 0) {
    const Waiting now = stack[static_cast<std::size_t>(top--)];
    if (now.squared >= best) {
      continue;
    }
    std::uint32_t index = now.node;
    // Down to the nearer leaf; the farther children are pushed onto the stack.
    while (nodes_[index].count == 0) {
      std::uint32_t near = index + 1;
      std::uint32_t far = nodes_[index].first;
      double near_squared = squared_distance_to_box(nodes_[near], point_mm);
      double far_squared = squared_distance_to_box(nodes_[far], point_mm);
      if (far_squared < near_squared) {
        std::swap(near, far);
        std::swap(near_squared, far_squared);
      }
      if (far_squared < best) {
        stack[static_cast<std::size_t>(++top)] = {far, far_squared};
      }
      index = near;
      if (near_squared >= best) {
        break;
      }
    }
    const Node &leaf = nodes_[index];
    for (std::uint32_t i = 0; i < leaf.count; ++i) {
      try_slot(leaf.first + i);
    }
  }

  return describe(best_slot, found, point_mm);
}

SurfacePoint SurfaceModel::describe(std::uint32_t slot, const Closest &found, const Vector3d &p) const noexcept {
  SurfacePoint out;
  out.point_mm = found.point;
  out.normal = normals_[std::size_t{kFeatures} * slot + found.feature];
  const double distance_mm = (p - found.point).norm();
  out.distance_mm = std::isnan(distance_mm) ? std::numeric_limits<double>::infinity() : distance_mm;
  out.signed_mm = out.normal.dot(p - found.point) < 0.0 ? -out.distance_mm : out.distance_mm;
  out.triangle = mesh_index_[slot];
  return out;
}

SurfacePoint SurfaceModel::closest_on(int triangle, const Vector3d &point_mm) const noexcept {
  const std::uint32_t slot = slot_[static_cast<std::size_t>(triangle)];
  return describe(slot, closest_on_triangle(corners_[slot], point_mm), point_mm);
}

SurfacePoint SurfaceModel::closest_among(std::span<const Candidate> candidates, double offset_mm,
                                         const Vector3d &point_mm, double *others_mm, double secure_mm) const noexcept {
  double best = std::numeric_limits<double>::infinity();
  double second = std::numeric_limits<double>::infinity();
  double reach = std::numeric_limits<double>::infinity();
  double rest = static_cast<double>(
      candidates.back().from_place_mm); // distance from the sorting point: all later candidates are farther
  std::uint32_t best_slot = 0;
  Closest found{Vector3d::Zero(), kFace};
  for (const Candidate &one : candidates) {
    const auto from_place = static_cast<double>(one.from_place_mm);
    if (from_place >= reach) {
      rest = from_place;
      break;
    }
    const std::uint32_t slot = slot_[static_cast<std::size_t>(one.triangle)];
    const Closest candidate = closest_on_triangle(corners_[slot], point_mm);
    const double d2 = (candidate.point - point_mm).squaredNorm();
    if (d2 < best) {
      second = best;
      best = d2;
      reach = std::sqrt(d2) + offset_mm + secure_mm;
      best_slot = slot;
      found = candidate;
    } else {
      second = std::min(second, d2);
    }
  }
  if (others_mm != nullptr) {
    *others_mm = std::min(std::sqrt(second), rest - offset_mm);
  }
  return describe(best_slot, found, point_mm);
}

bool SurfaceModel::segment_hits(const Vector3d &from_mm, const Vector3d &to_mm) const noexcept {
  const Vector3d along = to_mm - from_mm;
  const Vector3d inverse = along.cwiseInverse();
  std::array<std::uint32_t, kMaxDepth> stack;
  int top = 0;
  stack[0] = 0;
  while (top >= 0) {
    const std::uint32_t index = stack[static_cast<std::size_t>(top--)];
    const Node &node = nodes_[index];
    if (!segment_meets_box(node.low, node.high, from_mm, inverse)) {
      continue;
    }
    if (node.count == 0) {
      stack[static_cast<std::size_t>(++top)] = node.first;
      stack[static_cast<std::size_t>(++top)] = index + 1;
      continue;
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
      const Corners &t = corners_[i];
      if (segment_meets_triangle(t.a, t.b, t.c, from_mm, along)) {
        return true;
      }
    }
  }
  return false;
}

} // namespace bregma::surface
