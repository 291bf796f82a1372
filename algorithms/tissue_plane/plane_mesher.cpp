#include "algorithms/tissue_plane/plane_mesher.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <stdexcept>
#include <string>

#include "algorithms/tissue_plane/plane_smoothing.hpp"

namespace bregma::tissue_plane {
namespace {

// A lattice node closer to a crossing than this fraction of its edge is moved onto it, which avoids slivers.
constexpr double kWarp = 0.33;
constexpr double kHexHeight = 0.8660254037844386; // height of an equilateral triangle of edge 1

enum class Side : signed char { kOutside = -1, kOn = 0, kInside = 1 };

class Stuffing {
public:
  Stuffing(const Outline &outline, double edge_mm, const std::optional<double> &cut_y_mm);
  [[nodiscard]] PlaneMesh mesh();

private:
  [[nodiscard]] int index(int i, int j) const { return j * columns_ + i; }
  [[nodiscard]] Eigen::Vector2d &node(int i) { return nodes_[static_cast<std::size_t>(i)]; }
  [[nodiscard]] Side &side(int i) { return sides_[static_cast<std::size_t>(i)]; }
  void lay_lattice();
  void warp();
  void cut(std::array<int, 3> t);
  [[nodiscard]] Eigen::Vector2d crossing(int inside, int outside);
  [[nodiscard]] int cut_node(int inside, int outside);
  void add(int a, int b, int c) { triangles_.emplace_back(a, b, c); }

  const Outline &outline_;
  double edge_;
  std::optional<double> cut_y_;
  int columns_ = 0;
  int rows_ = 0;
  std::vector<Eigen::Vector2d> nodes_;
  std::vector<Side> sides_;
  std::vector<std::array<int, 3>> lattice_;
  std::vector<Eigen::Vector3i> triangles_;
  std::map<std::pair<int, int>, int> cut_nodes_;
};

Stuffing::Stuffing(const Outline &outline, double edge_mm, const std::optional<double> &cut_y_mm)
    : outline_(outline), edge_(edge_mm), cut_y_(cut_y_mm) {
  lay_lattice();
  warp();
}

void Stuffing::lay_lattice() {
  Eigen::Vector2d low = outline_.outer.front();
  Eigen::Vector2d high = low;
  for (const Eigen::Vector2d &p : outline_.outer) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double row_mm = kHexHeight * edge_;
  // A row lies on the line to be cut; without such a line, in the middle.
  const double on_row = cut_y_.value_or(0.5 * (low.y() + high.y()));
  low.y() = on_row - row_mm * (std::ceil((on_row - low.y()) / row_mm) + 1.0);
  low.x() -= edge_;
  columns_ = static_cast<int>(std::ceil((high.x() - low.x()) / edge_)) + 2;
  rows_ = static_cast<int>(std::ceil((high.y() - low.y()) / row_mm)) + 2;
  for (int j = 0; j < rows_; ++j) {
    for (int i = 0; i < columns_; ++i) {
      nodes_.emplace_back(low.x() + edge_ * (i + 0.5 * (j & 1)), low.y() + row_mm * j);
      sides_.push_back(contains(outline_, nodes_.back()) ? Side::kInside : Side::kOutside);
    }
  }
  for (int j = 0; j + 1 < rows_; ++j) {
    for (int i = 0; i + 1 < columns_; ++i) {
      const int a = index(i, j);
      const int b = index(i + 1, j);
      const int c = index(i + 1, j + 1);
      const int d = index(i, j + 1);
      if ((j & 1) == 0) { // the row above is half an edge to the right
        lattice_.push_back({a, b, d});
        lattice_.push_back({b, c, d});
      } else {
        lattice_.push_back({a, b, c});
        lattice_.push_back({a, c, d});
      }
    }
  }
}

Eigen::Vector2d Stuffing::crossing(int inside, int outside) {
  Eigen::Vector2d in = node(inside);
  Eigen::Vector2d out = node(outside);
  for (int k = 0; k < 30; ++k) { // to a billionth of an edge
    const Eigen::Vector2d middle = 0.5 * (in + out);
    (contains(outline_, middle) ? in : out) = middle;
  }
  return 0.5 * (in + out);
}

void Stuffing::warp() {
  struct Move {
    double fraction = kWarp;
    Eigen::Vector2d to = Eigen::Vector2d::Zero();
    bool wanted = false;
  };
  std::vector<Move> moves(nodes_.size());
  for (const auto &t : lattice_) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = t[k];
      const int b = t[(k + 1) % 3];
      if (side(a) == side(b)) {
        continue;
      }
      const Eigen::Vector2d p = side(a) == Side::kInside ? crossing(a, b) : crossing(b, a);
      for (const int end : {a, b}) {
        const double fraction = (p - node(end)).norm() / edge_;
        // A node of the line to be cut moves only along that line.
        const bool off_line =
            cut_y_ && std::abs(node(end).y() - *cut_y_) < 1e-6 * edge_ && std::abs(p.y() - *cut_y_) > 1e-6 * edge_;
        Move &move = moves[static_cast<std::size_t>(end)];
        if (fraction < move.fraction && !off_line) {
          move = {fraction, p, true};
        }
      }
    }
  }
  for (std::size_t i = 0; i < moves.size(); ++i) {
    if (moves[i].wanted) {
      nodes_[i] = moves[i].to;
      sides_[i] = Side::kOn;
    }
  }
}

int Stuffing::cut_node(int inside, int outside) {
  const auto [it, added] = cut_nodes_.try_emplace({inside, outside}, static_cast<int>(nodes_.size()));
  if (added) {
    const Eigen::Vector2d p = crossing(inside, outside);
    nodes_.push_back(p);
    sides_.push_back(Side::kOn);
  }
  return it->second;
}

void Stuffing::cut(std::array<int, 3> t) {
  const auto count = [&](Side s) { return std::count_if(t.begin(), t.end(), [&](int i) { return side(i) == s; }); };
  const auto inside = count(Side::kInside);
  const auto outside = count(Side::kOutside);
  const auto turn_until = [&](Side s) { // cyclic, which keeps the orientation
    while (side(t[0]) != s) {
      std::rotate(t.begin(), t.begin() + 1, t.end());
    }
  };
  if (outside == 0) {
    if (inside > 0 || contains(outline_, (node(t[0]) + node(t[1]) + node(t[2])) / 3.0)) {
      add(t[0], t[1], t[2]);
    }
  } else if (inside == 1 && outside == 2) {
    turn_until(Side::kInside);
    add(t[0], cut_node(t[0], t[1]), cut_node(t[0], t[2]));
  } else if (inside == 1 && outside == 1) {
    turn_until(Side::kOn);
    if (side(t[1]) == Side::kInside) {
      add(t[0], t[1], cut_node(t[1], t[2]));
    } else {
      add(t[0], cut_node(t[2], t[1]), t[2]);
    }
  } else if (inside == 2) {
    turn_until(Side::kOutside);
    const int p = cut_node(t[1], t[0]);
    const int q = cut_node(t[2], t[0]);
    if ((node(p) - node(t[2])).squaredNorm() < (node(q) - node(t[1])).squaredNorm()) {
      add(p, t[1], t[2]);
      add(p, t[2], q);
    } else {
      add(p, t[1], q);
      add(q, t[1], t[2]);
    }
  }
}

PlaneMesh Stuffing::mesh() {
  for (const auto &t : lattice_) {
    cut(t);
  }
  return {std::move(nodes_), std::move(triangles_)};
}

// Triangles connected by edges get the same label.
std::vector<int> pieces_of(const std::vector<Eigen::Vector3i> &triangles) {
  std::vector<int> parent(triangles.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int i) {
    while (parent[static_cast<std::size_t>(i)] != i) {
      i = parent[static_cast<std::size_t>(i)] = parent[static_cast<std::size_t>(parent[static_cast<std::size_t>(i)])];
    }
    return i;
  };
  std::map<std::pair<int, int>, int> owner;
  for (std::size_t e = 0; e < triangles.size(); ++e) {
    for (int k = 0; k < 3; ++k) {
      const std::pair<int, int> edge = std::minmax({triangles[e][k], triangles[e][(k + 1) % 3]});
      const auto [it, added] = owner.try_emplace(edge, static_cast<int>(e));
      if (!added) {
        parent[static_cast<std::size_t>(root(it->second))] = root(static_cast<int>(e));
      }
    }
  }
  for (std::size_t e = 0; e < parent.size(); ++e) {
    parent[e] = root(static_cast<int>(e));
  }
  return parent;
}

void keep_largest_piece(PlaneMesh &mesh) {
  const std::vector<int> piece = pieces_of(mesh.triangles);
  std::vector<int> size(mesh.triangles.size(), 0);
  for (const int p : piece) {
    ++size[static_cast<std::size_t>(p)];
  }
  const int largest = static_cast<int>(std::max_element(size.begin(), size.end()) - size.begin());
  std::vector<Eigen::Vector3i> kept;
  for (std::size_t e = 0; e < piece.size(); ++e) {
    if (piece[e] == largest) {
      kept.push_back(mesh.triangles[e]);
    }
  }
  mesh.triangles = std::move(kept);
}

// If two fans of triangles touch only at a node, each gets a separate node.
void split_pinched_nodes(PlaneMesh &mesh) {
  std::vector<std::vector<int>> around(mesh.nodes_mm.size());
  for (std::size_t e = 0; e < mesh.triangles.size(); ++e) {
    for (const int n : mesh.triangles[e]) {
      around[static_cast<std::size_t>(n)].push_back(static_cast<int>(e));
    }
  }
  for (std::size_t n = 0; n < around.size(); ++n) {
    std::vector<Eigen::Vector3i> star;
    for (const int e : around[n]) {
      star.push_back(mesh.triangles[static_cast<std::size_t>(e)]);
    }
    const std::vector<int> fan = pieces_of(star);
    std::map<int, int> node_of_fan;
    for (std::size_t k = 0; k < star.size(); ++k) {
      const int fresh = node_of_fan.empty() ? static_cast<int>(n) : static_cast<int>(mesh.nodes_mm.size());
      const auto [it, added] = node_of_fan.try_emplace(fan[k], fresh);
      if (added && it->second != static_cast<int>(n)) {
        const Eigen::Vector2d p = mesh.nodes_mm[n];
        mesh.nodes_mm.push_back(p);
      }
      for (int &corner : mesh.triangles[static_cast<std::size_t>(around[n][k])]) {
        corner = corner == static_cast<int>(n) ? it->second : corner;
      }
    }
  }
}

void drop_unused_nodes(PlaneMesh &mesh) {
  std::vector<int> renamed(mesh.nodes_mm.size(), -1);
  std::vector<Eigen::Vector2d> nodes;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    for (const int n : t) {
      renamed[static_cast<std::size_t>(n)] = 0;
    }
  }
  for (std::size_t i = 0; i < renamed.size(); ++i) {
    if (renamed[i] == 0) {
      renamed[i] = static_cast<int>(nodes.size());
      nodes.push_back(mesh.nodes_mm[i]);
    }
  }
  for (Eigen::Vector3i &t : mesh.triangles) {
    t = {renamed[static_cast<std::size_t>(t[0])], renamed[static_cast<std::size_t>(t[1])],
         renamed[static_cast<std::size_t>(t[2])]};
  }
  mesh.nodes_mm = std::move(nodes);
}

void check_input(const Outline &outline, const PlaneMeshing &meshing) {
  if (outline.outer.size() < 3) {
    throw std::invalid_argument("fill: the outline has " + std::to_string(outline.outer.size()) +
                                " points, must have at least 3");
  }
  for (const Eigen::Vector2d &p : outline.outer) {
    if (!p.allFinite()) {
      throw std::invalid_argument("fill: the outline has a point that is not finite");
    }
  }
  if (!(area_mm2(outline) > 0.0)) {
    throw std::invalid_argument("fill: the outline encloses " + std::to_string(area_mm2(outline)) +
                                " mm^2, must be positive");
  }
  if (!(meshing.edge_mm >= 0.0) || !std::isfinite(meshing.edge_mm)) {
    throw std::invalid_argument("fill: edge_mm = " + std::to_string(meshing.edge_mm) + ", must not be negative");
  }
  if (meshing.edge_mm == 0.0 && meshing.triangles < 10) {
    throw std::invalid_argument("fill: triangles = " + std::to_string(meshing.triangles) + ", must be at least 10");
  }
}

PlaneMesh fill_with(const Outline &outline, double edge_mm, const std::optional<double> &cut_y_mm) {
  PlaneMesh mesh = Stuffing(outline, edge_mm, cut_y_mm).mesh();
  if (mesh.triangles.empty()) {
    throw std::invalid_argument("fill: no triangle of edge " + std::to_string(edge_mm) + " mm fits into the outline");
  }
  keep_largest_piece(mesh);
  split_pinched_nodes(mesh);
  drop_unused_nodes(mesh);
  return mesh;
}

} // namespace

PlaneMesh fill(const Outline &outline, const PlaneMeshing &meshing) {
  check_input(outline, meshing);
  double edge_mm = meshing.edge_mm;
  if (edge_mm == 0.0) {
    // First from the area, then corrected by the resulting number, because the cut triangles along the outline are
    // small.
    edge_mm = std::sqrt(area_mm2(outline) / (0.5 * kHexHeight * meshing.triangles));
    const auto count = static_cast<double>(fill_with(outline, edge_mm, meshing.cut_y_mm).triangles.size());
    edge_mm *= std::sqrt(count / meshing.triangles);
  }
  PlaneMesh mesh = fill_with(outline, edge_mm, meshing.cut_y_mm);
  smooth(mesh, outline, meshing.cut_y_mm, meshing.smoothing_sweeps);
  return mesh;
}

} // namespace bregma::tissue_plane
