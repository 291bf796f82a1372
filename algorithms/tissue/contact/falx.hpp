// The falx: the fold of dura between the hemispheres, taut from the skull's vault down to above the corpus callosum.
// Tissue slides along it and cannot pass through it: in a head that lies on its side it supports the upper hemisphere.
//
// The falx is assumed rigid, in the brain's plane of symmetry, from the crista galli over the vertex to the inner
// occipital protuberance. It is a sickle with a depth of 25 mm in front and 50 mm behind. Nodes within a quarter of a
// lattice cell of the plane lose the displacement normal to it.
//
// Frame: that of the mesh (Image, RAS: the falx is normal to x, the vertex is up along z, the face towards y), mm. One
// thread at a time; apply() does not allocate or throw.
#pragma once

#include <vector>

#include <Eigen/Geometry>

#include "algorithms/tissue/mesh/tet_mesh.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::surface {
class SurfaceModel;
} // namespace bregma::surface

namespace bregma::tissue {

using Plane = Eigen::Hyperplane<double, 3>; // mm, its normal of length 1

// The plane of symmetry of a surface: Gauss-Newton on the plane's normal and offset, with closest points, point to
// plane. It starts from first_normal, through the points' centroid.
[[nodiscard]] Plane symmetry_plane(const std::vector<Eigen::Vector3d> &points_mm, const surface::SurfaceModel &surface,
                                   const Eigen::Vector3d &first_normal);

class Falx final : public Contact {
public:
  // surface: the brain's, at rest.
  Falx(const TetMesh &mesh, const TetBoundary &boundary, const surface::SurfaceModel &surface);

  [[nodiscard]] const Plane &plane() const noexcept { return plane_; }
  [[nodiscard]] const std::vector<int> &nodes() const noexcept { return nodes_; } // nodes that it constrains

  void apply(const NodeMotion &nodes) noexcept override;

private:
  Plane plane_;
  std::vector<int> nodes_;
};

} // namespace bregma::tissue
