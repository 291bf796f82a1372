#include "algorithms/tissue/mesh/lattice_stuffing.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <utility>

#include "algorithms/tissue/mesh/mesh_quality.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;
using surface::SurfaceModel;
using surface::SurfacePoint;

// Lattice points have three coordinates of one parity, in halves of the long edge: even are the cubes' corners, odd
// their centres. The first three directions lead to neighbours of the same parity, the others to those of the other.
constexpr int kWays = 7;
constexpr int kLongWays = 3;
constexpr int kWay[kWays][3] = {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}, {1, 1, 1}, {-1, 1, 1}, {1, -1, 1}, {-1, -1, 1}};
constexpr double kShortEdge = 0.8660254037844386; // relative to the long edge
// The search of a cut ends at this fraction of the long edge; a lattice point this near to the surface lies on it.
constexpr double kOnSurface = 1e-4;

// A cut nearer to a lattice point than this fraction of its edge is not made: the point moves onto the surface instead.
struct SnapShares {
  double along_long;
  double along_short;
};
// Those of [Labelle 2007], with dihedral angles between 10.7 and 164.8 degrees on a smooth surface.
constexpr SnapShares kPaperSnap = {0.24999, 0.41189};
constexpr SnapShares kFarSnap = {0.5, 0.5};
// Minimum stable length after a far move, as a fraction of the long edge; the lattice's own tetrahedra have 0.35.
constexpr double kMinStableLength = 0.07;

struct Cut {
  double from_low = 0.5; // fraction of the edge, from the end where its direction starts
  Vector3d point_mm;
};

class Lattice {
public:
  Lattice(const SurfaceModel &surface, double edge_mm, const Vector3d &shift) : surface_(surface), edge_mm_(edge_mm) {
    const Vector3d size = surface.high_mm() - surface.low_mm();
    for (int i = 0; i < 3; ++i) {
      count_[i] = 2 * (static_cast<int>(std::floor(size[i] / edge_mm)) + 3) + 1;
    }
    origin_ = surface.centre_mm() - edge_mm * (0.25 * (count_.array() - 1).cast<double>().matrix() + shift);
  }

  [[nodiscard]] TetMesh fill() {
    measure();
    cut();
    warp();
    collect();
    return std::move(mesh_);
  }

private:
  enum class Side : signed char { kOutside = -1, kOn = 0, kInside = 1 };

  [[nodiscard]] bool holds(const Vector3i &p) const {
    return (p.array() >= 0).all() && (p.array() < count_.array()).all();
  }
  [[nodiscard]] std::size_t index(const Vector3i &p) const {
    return static_cast<std::size_t>(p.x()) +
           static_cast<std::size_t>(count_.x()) *
               (static_cast<std::size_t>(p.y()) +
                static_cast<std::size_t>(count_.y()) * static_cast<std::size_t>(p.z()));
  }
  [[nodiscard]] Vector3d place(const Vector3i &p) const { return origin_ + 0.5 * edge_mm_ * p.cast<double>(); }

  template <class Visit> void each_point(Visit &&visit) const {
    for (int z = 0; z < count_.z(); ++z) {
      for (int y = z % 2; y < count_.y(); y += 2) {
        for (int x = z % 2; x < count_.x(); x += 2) {
          visit(Vector3i(x, y, z));
        }
      }
    }
  }

  void measure() {
    const std::size_t size = static_cast<std::size_t>(count_.x()) * static_cast<std::size_t>(count_.y()) *
                             static_cast<std::size_t>(count_.z());
    side_.assign(size, Side::kOutside);
    point_mm_.resize(size);
    // Along a row the distance changes by no more than the step: far from the surface most points need no query.
    double known = 0.0;
    Vector3d asked = Vector3d::Constant(1e9);
    int triangle = 0;
    each_point([&](const Vector3i &p) {
      const std::size_t at = index(p);
      point_mm_[at] = place(p);
      if (std::abs(known) <= (point_mm_[at] - asked).norm() + kOnSurface * edge_mm_) {
        const SurfacePoint closest = surface_.closest(point_mm_[at], triangle);
        known = closest.signed_mm;
        asked = point_mm_[at];
        triangle = closest.triangle;
        if (closest.distance_mm <= kOnSurface * edge_mm_) {
          side_[at] = Side::kOn;
          return;
        }
      }
      side_[at] = known < 0.0 ? Side::kInside : Side::kOutside;
    });
  }

  void cut() {
    each_point([&](const Vector3i &p) {
      for (int way = 0; way < kWays; ++way) {
        const Vector3i q = p + Vector3i(kWay[way][0], kWay[way][1], kWay[way][2]);
        if (holds(q) && crosses(index(p), index(q))) {
          cut_of_edge_.emplace(index(p) * kWays + static_cast<std::size_t>(way), static_cast<int>(cuts_.size()));
          cuts_.push_back(root(index(p), index(q)));
        }
      }
    });
  }

  [[nodiscard]] bool crosses(std::size_t p, std::size_t q) const {
    return side_[p] != Side::kOn && side_[q] != Side::kOn && side_[p] != side_[q];
  }

  // Regula falsi in the Illinois form [Dowell 1971], on the signed distance along the edge.
  [[nodiscard]] Cut root(std::size_t p, std::size_t q) const {
    const auto at = [&](double t) -> Vector3d { return (1.0 - t) * point_mm_[p] + t * point_mm_[q]; };
    SurfacePoint closest = surface_.closest(point_mm_[p]);
    double low = 0.0;
    double f_low = closest.signed_mm;
    double high = 1.0;
    closest = surface_.closest(point_mm_[q], closest.triangle);
    double f_high = closest.signed_mm;
    double t = 0.5;
    for (int step = 0; step < 40; ++step) {
      t = f_high == f_low ? 0.5 * (low + high) : low + (high - low) * f_low / (f_low - f_high);
      closest = surface_.closest(at(t), closest.triangle);
      const double f = closest.signed_mm;
      if (std::abs(f) <= kOnSurface * edge_mm_) {
        break;
      }
      if ((f < 0.0) == (f_high < 0.0)) {
        high = t;
        f_high = f;
        f_low *= 0.5;
      } else {
        low = std::exchange(high, t);
        f_low = std::exchange(f_high, f);
      }
    }
    return {t, at(t)};
  }

  // The cut between a point and its neighbour along a direction, or against it.
  [[nodiscard]] const Cut *cut_between(std::size_t low, std::size_t high, int way) const {
    if (!crosses(low, high)) {
      return nullptr;
    }
    return &cuts_[static_cast<std::size_t>(cut_of_edge_.at(low * kWays + static_cast<std::size_t>(way)))];
  }

  // The nearest cut on the point's edges that lies within the snap fractions; null where there is none.
  [[nodiscard]] const Vector3d *near_cut(const Vector3i &p, const SnapShares &snap) const {
    const Vector3d *nearest = nullptr;
    double shortest = 2.0;
    for (int way = 0; way < 2 * kWays; ++way) {
      const int forward = way % kWays;
      const Vector3i step(kWay[forward][0], kWay[forward][1], kWay[forward][2]);
      const Vector3i q = way < kWays ? Vector3i(p + step) : Vector3i(p - step);
      const Cut *const cut = !holds(q)     ? nullptr
                             : way < kWays ? cut_between(index(p), index(q), forward)
                                           : cut_between(index(q), index(p), forward);
      if (cut == nullptr) {
        continue;
      }
      const double fraction = way < kWays ? cut->from_low : 1.0 - cut->from_low;
      const bool is_long = forward < kLongWays;
      const double length = is_long ? fraction : fraction * kShortEdge;
      if (fraction < (is_long ? snap.along_long : snap.along_short) && length < shortest) {
        shortest = length;
        nearest = &cut->point_mm;
      }
    }
    return nearest;
  }

  // First as in [Labelle 2007], which keeps every tetrahedron valid for any surface. Then farther ones, where none of
  // the tetrahedra about the point gets thin: a point on the surface gives better tetrahedra than a cut next to it.
  void warp() {
    each_point([&](const Vector3i &p) {
      if (const Vector3d *const cut = near_cut(p, kPaperSnap)) {
        point_mm_[index(p)] = *cut;
        side_[index(p)] = Side::kOn;
      }
    });
    each_point([&](const Vector3i &p) {
      if (const Vector3d *const cut = near_cut(p, kFarSnap)) {
        const Vector3d before = std::exchange(point_mm_[index(p)], *cut);
        if (thinnest_about(p) < kMinStableLength * edge_mm_) {
          point_mm_[index(p)] = before;
        } else {
          side_[index(p)] = Side::kOn;
        }
      }
    });
  }

  // The four tetrahedra around the long edge from p along an axis, positive. Each tetrahedron has one long edge
  // between centres and one between corners; `along` is 2 or -2.
  [[nodiscard]] std::array<std::array<Vector3i, 4>, 4> about_edge(const Vector3i &p, int axis, int along) const {
    Vector3i to = Vector3i::Zero();
    Vector3i u = Vector3i::Zero();
    Vector3i v = Vector3i::Zero();
    to[axis] = along;
    u[(axis + 1) % 3] = 1;
    v[(axis + 2) % 3] = along / 2;
    const Vector3i middle = p + to / 2;
    const std::array<Vector3i, 4> corner = {middle + u + v, middle - u + v, middle - u - v, middle + u - v};
    std::array<std::array<Vector3i, 4>, 4> out;
    for (std::size_t i = 0; i < 4; ++i) {
      out[i] = {p, p + to, corner[i], corner[(i + 1) % 4]};
    }
    return out;
  }

  [[nodiscard]] double thinnest_about(const Vector3i &p) const {
    double thinnest = edge_mm_;
    for (int axis = 0; axis < 3; ++axis) {
      for (const int along : {2, -2}) {
        for (const auto &t : about_edge(p, axis, along)) {
          if (std::all_of(t.begin(), t.end(), [this](const Vector3i &q) { return holds(q); })) {
            thinnest = std::min(thinnest, stable_length_mm(point_mm_[index(t[0])], point_mm_[index(t[1])],
                                                           point_mm_[index(t[2])], point_mm_[index(t[3])]));
          }
        }
      }
    }
    return thinnest;
  }

  void collect() {
    node_of_point_.assign(side_.size(), -1);
    node_of_cut_.assign(cuts_.size(), -1);
    each_point([&](const Vector3i &p) {
      for (int axis = 0; axis < 3 && p.x() % 2 == 1; ++axis) {
        Vector3i to = p;
        to[axis] += 2;
        for (const auto &t : about_edge(p, axis, 2)) {
          if (holds(to)) {
            clip(t);
          }
        }
      }
    });
  }

  // The part of one tetrahedron that is inside.
  void clip(std::array<Vector3i, 4> t) {
    const auto side = [&](int i) { return static_cast<int>(side_[index(t[static_cast<std::size_t>(i)])]); };
    if (side(0) < 0 && side(1) < 0 && side(2) < 0 && side(3) < 0) {
      return;
    }
    // Inside first, outside last; two of the four are always on the same side, so the orientation can be kept.
    bool odd = false;
    for (int i = 1; i < 4; ++i) {
      for (int j = i; j > 0 && side(j) > side(j - 1); --j) {
        std::swap(t[static_cast<std::size_t>(j)], t[static_cast<std::size_t>(j - 1)]);
        odd = !odd;
      }
    }
    for (int i = 1; i < 4 && odd; ++i) {
      if (side(i) == side(i - 1)) {
        std::swap(t[static_cast<std::size_t>(i)], t[static_cast<std::size_t>(i - 1)]);
        odd = false;
      }
    }
    int inside = 0;
    int outside = 0;
    for (int i = 0; i < 4; ++i) {
      inside += side(i) > 0 ? 1 : 0;
      outside += side(i) < 0 ? 1 : 0;
    }
    const auto n = [&](int i) { return node(t[static_cast<std::size_t>(i)]); };
    const auto c = [&](int i, int j) {
      return cut_node(t[static_cast<std::size_t>(i)], t[static_cast<std::size_t>(j)]);
    };
    const auto lower = [&](int i, int j, int out) {
      return keeps_diagonal(t[static_cast<std::size_t>(i)], t[static_cast<std::size_t>(j)],
                            t[static_cast<std::size_t>(out)]);
    };
    if (inside == 0) {
      return;
    }
    if (outside == 0) {
      mesh_.tetrahedra.push_back({n(0), n(1), n(2), n(3)});
    } else if (inside == 1) {
      const auto clipped = [&](int i) { return side(i) < 0 ? c(0, i) : n(i); };
      mesh_.tetrahedra.push_back({n(0), clipped(1), clipped(2), clipped(3)});
    } else if (inside == 2 && outside == 1) { // a pyramid over the cut face
      if (lower(0, 1, 3)) {
        mesh_.tetrahedra.push_back({n(0), n(1), n(2), c(1, 3)});
        mesh_.tetrahedra.push_back({n(0), c(1, 3), n(2), c(0, 3)});
      } else {
        mesh_.tetrahedra.push_back({n(0), n(1), n(2), c(0, 3)});
        mesh_.tetrahedra.push_back({c(0, 3), n(1), n(2), c(1, 3)});
      }
    } else if (inside == 2) {
      const bool first = lower(0, 1, 2);
      const bool second = lower(0, 1, 3);
      // Where the two faces' diagonals end at one inner node, the diagonal on the surface is free: the shorter is used.
      // Otherwise it joins the cuts at which they end, since any other choice cannot be filled.
      const bool third = first == second ? (point(c(0, 2)) - point(c(1, 3))).squaredNorm() <
                                               (point(c(0, 3)) - point(c(1, 2))).squaredNorm()
                                         : second;
      prism({n(0), c(0, 2), c(0, 3)}, {n(1), c(1, 2), c(1, 3)}, first, third, second);
    } else {
      prism({n(0), n(1), n(2)}, {c(0, 3), c(1, 3), c(2, 3)}, lower(0, 1, 3), lower(1, 2, 3), lower(0, 2, 3));
    }
  }

  // On the face of two inner points and an outer one: true where the diagonal leaves the first of the inner ones (and
  // ends at the second one's cut).
  [[nodiscard]] bool keeps_diagonal(const Vector3i &first, const Vector3i &second, const Vector3i &outer) const {
    const auto is_long = [](const Vector3i &a, const Vector3i &b) { return (a - b).cwiseAbs().sum() == 2; };
    if (is_long(first, second)) {
      return index(first) < index(second);
    }
    return is_long(second, outer) == kDiagonalEndsAtLongCut;
  }

  // a0 a1 a2 b0 positive. a01: the diagonal of the side 0-1 leaves a0 (else b0), and so on; never all three around.
  void prism(std::array<int, 3> a, const std::array<int, 3> &b, bool a01, bool a12, bool a02) {
    std::array<int, 3> rank = {(a01 ? 0 : 1) + (a02 ? 0 : 1), (a01 ? 1 : 0) + (a12 ? 0 : 1),
                               (a12 ? 1 : 0) + (a02 ? 1 : 0)};
    for (int r = 2; r >= 0; --r) {
      for (std::size_t i = 0; i < 3; ++i) {
        if (rank[i] == r) {
          mesh_.tetrahedra.push_back({a[0], a[1], a[2], b[i]});
          a[i] = b[i];
        }
      }
    }
  }

  [[nodiscard]] const Vector3d &point(int node) const { return mesh_.nodes_mm[static_cast<std::size_t>(node)]; }

  int node(const Vector3i &p) { return numbered(node_of_point_[index(p)], point_mm_[index(p)]); }

  int cut_node(const Vector3i &a, const Vector3i &b) {
    for (int way = 0; way < kWays; ++way) {
      const Vector3i step(kWay[way][0], kWay[way][1], kWay[way][2]);
      const Cut *const cut = a + step == b   ? cut_between(index(a), index(b), way)
                             : b + step == a ? cut_between(index(b), index(a), way)
                                             : nullptr;
      if (cut != nullptr) {
        return numbered(node_of_cut_[static_cast<std::size_t>(cut - cuts_.data())], cut->point_mm);
      }
    }
    return -1; // not reached: called for edges that cross
  }

  int numbered(int &number, const Vector3d &place_mm) {
    if (number < 0) {
      number = static_cast<int>(mesh_.nodes_mm.size());
      mesh_.nodes_mm.push_back(place_mm);
    }
    return number;
  }

  static constexpr bool kDiagonalEndsAtLongCut = true;

  const SurfaceModel &surface_;
  double edge_mm_;
  Vector3i count_;
  Vector3d origin_;
  std::vector<Side> side_;
  std::vector<Vector3d> point_mm_;
  std::vector<Cut> cuts_;
  std::unordered_map<std::size_t, int> cut_of_edge_;
  std::vector<int> node_of_point_;
  std::vector<int> node_of_cut_;
  TetMesh mesh_;
};

} // namespace

TetMesh stuff(const SurfaceModel &surface, double edge_mm, const Vector3d &shift) {
  return Lattice(surface, edge_mm, shift).fill();
}

double lattice_points(const SurfaceModel &surface, double edge_mm) {
  return ((surface.high_mm() - surface.low_mm()).array() / edge_mm + 4.0).prod() * 2.0;
}

} // namespace bregma::tissue
