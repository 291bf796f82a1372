#include "algorithms/tissue/mesh/mesh_smoothing.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <Eigen/Geometry>

#include "algorithms/tissue/mesh/mesh_quality.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;
using surface::SurfaceModel;
using surface::SurfacePoint;

// Tetrahedra with at least this stable length, as a fraction of the lattice's long edge, are left unchanged. The
// lattice's own have 0.354; a higher value moves many nodes for little gain.
constexpr double kEnough = 0.28;
// Steps of the search as fractions of the edge, and the minimum gain for a move.
constexpr std::array<double, 4> kSteps = {0.16, 0.08, 0.04, 0.02};
constexpr double kMinGain = 1e-3;
constexpr int kTriesAtOneStep = 4;

// Towards the corners and faces of a cube.
const std::array<Vector3d, 14> &directions() {
  static const std::array<Vector3d, 14> all = [] {
    std::array<Vector3d, 14> out;
    for (std::size_t i = 0; i < 3; ++i) {
      out[2 * i] = Vector3d::Unit(static_cast<Eigen::Index>(i));
      out[2 * i + 1] = -out[2 * i];
    }
    for (unsigned i = 0; i < 8; ++i) {
      out[6 + i] = Vector3d((i & 1U) != 0 ? 1 : -1, (i & 2U) != 0 ? 1 : -1, (i & 4U) != 0 ? 1 : -1).normalized();
    }
    return out;
  }();
  return all;
}

class Smoother {
public:
  Smoother(TetMesh &mesh, const SurfaceModel &surface, double edge_mm)
      : mesh_(mesh), surface_(surface), edge_mm_(edge_mm), on_surface_(mesh.nodes_mm.size(), false),
        settled_(mesh.nodes_mm.size(), false), triangle_(mesh.nodes_mm.size(), 0), first_(mesh.nodes_mm.size() + 1, 0) {
    for (const int node : boundary_of(mesh).nodes) {
      on_surface_[static_cast<std::size_t>(node)] = true;
      triangle_[static_cast<std::size_t>(node)] =
          surface.closest(mesh.nodes_mm[static_cast<std::size_t>(node)]).triangle;
    }
    for (const Eigen::Vector4i &t : mesh.tetrahedra) {
      for (const int node : t) {
        ++first_[static_cast<std::size_t>(node) + 1];
      }
    }
    for (std::size_t i = 1; i < first_.size(); ++i) {
      first_[i] += first_[i - 1];
    }
    incident_.resize(4 * mesh.tetrahedra.size());
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    for (const Eigen::Vector4i &t : mesh.tetrahedra) {
      for (const int node : t) {
        incident_[next[static_cast<std::size_t>(node)]++] = &t;
      }
    }
  }

  void run(int sweeps) {
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      bool moved = false;
      for (std::size_t node = 0; node < mesh_.nodes_mm.size(); ++node) {
        if (!settled_[node] && improve(node)) {
          moved = true;
          for (std::size_t i = first_[node]; i < first_[node + 1]; ++i) {
            for (const int neighbour : *incident_[i]) {
              settled_[static_cast<std::size_t>(neighbour)] = false;
            }
          }
        } else {
          settled_[node] = true;
        }
      }
      if (!moved) {
        return;
      }
    }
  }

private:
  [[nodiscard]] double length_mm(const Eigen::Vector4i &t) const {
    const auto node = [&](int i) -> const Vector3d & { return mesh_.nodes_mm[static_cast<std::size_t>(t[i])]; };
    return stable_length_mm(node(0), node(1), node(2), node(3));
  }

  // The minimum stable length of the node's tetrahedra, or any value not above `floor` as soon as that is certain. The
  // tetrahedron that decided is tested first the next time, since it is likely to decide again.
  [[nodiscard]] double worst(std::size_t node, double floor) {
    double least = std::numeric_limits<double>::infinity();
    std::size_t decisive = first_[node];
    for (std::size_t i = first_[node]; i < first_[node + 1] && least > floor; ++i) {
      if (const double length = length_mm(*incident_[i]); length < least) {
        least = length;
        decisive = i;
      }
    }
    std::swap(incident_[first_[node]], incident_[decisive]);
    return least;
  }

  bool improve(std::size_t node) {
    double best = worst(node, -std::numeric_limits<double>::infinity());
    if (best >= kEnough * edge_mm_) {
      return false;
    }
    const double min_gain = kMinGain * edge_mm_;
    bool moved = false;
    for (const double step : kSteps) {
      for (int tries = 0; tries < kTriesAtOneStep && try_step(node, step * edge_mm_, min_gain, best); ++tries) {
        moved = true;
      }
    }
    return moved;
  }

  // The best position one step away, if it is better than the present one.
  bool try_step(std::size_t node, double step_mm, double min_gain, double &best) {
    Vector3d &place = mesh_.nodes_mm[node];
    const Vector3d start = place;
    const SurfacePoint here = on_surface_[node] ? surface_.closest(start, triangle_[node]) : SurfacePoint{};
    Vector3d best_place = start;
    bool better = false;
    for (const Vector3d &direction : directions()) {
      place = start + step_mm * direction;
      if (on_surface_[node]) {
        place -= step_mm * direction.dot(here.normal) * here.normal;
        place = surface_.closest(place, triangle_[node]).point_mm;
      }
      if (const double found = worst(node, best + min_gain); found > best + min_gain) {
        best = found;
        best_place = place;
        better = true;
      }
    }
    place = best_place;
    return better;
  }

  TetMesh &mesh_;
  const SurfaceModel &surface_;
  double edge_mm_;
  std::vector<bool> on_surface_;
  std::vector<bool> settled_;      // no better position was found, and no neighbour has moved since
  std::vector<int> triangle_;      // triangle of the surface near each boundary node
  std::vector<std::size_t> first_; // first entry of each node in incident_
  std::vector<const Eigen::Vector4i *> incident_;
};

} // namespace

void smooth(TetMesh &mesh, const SurfaceModel &surface, double edge_mm, int sweeps) {
  Smoother(mesh, surface, edge_mm).run(sweeps);
}

} // namespace bregma::tissue
