// The inner skull that supports the brain: the brain's own surface at rest plus a gap of fluid, open at the craniotomy.
// The brain slides along it without friction, or is fixed to it.
//
// Each node of the brain's surface has a tangent plane of the skull, found again when the node has slid by a millimetre
// or two. Contact with flat triangles and their edges would chatter, and no static solution would be found.
//
// One thread at a time; apply() does not allocate or throw.
#pragma once

#include <memory>
#include <vector>

#include "algorithms/tissue/mesh/tet_mesh.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::surface {
class SurfaceModel;
} // namespace bregma::surface

namespace bregma::tissue {

struct Craniotomy {
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  double radius_mm = 0.0; // 0: none
};

struct SkullOptions {
  bool sliding = true; // false: fixed [thesis, section 6.3.1]
  double gap_mm = 0.0; // outward motion of the surface before it touches
  Craniotomy craniotomy;
};

class Skull final : public Contact {
public:
  // Throws std::invalid_argument for a gap or a radius that is negative or not finite.
  Skull(const TetMesh &mesh, const TetBoundary &boundary, const SkullOptions &options);
  ~Skull() override;

  // Fixes the surface outside the craniotomy unless it slides. Call once, and again after nodes were released.
  void apply_supports(ExplicitSolver &solver) const;

  // True where the craniotomy leaves the surface free.
  [[nodiscard]] bool open_at(const Eigen::Vector3d &rest_mm) const noexcept;

  // The brain's surface at rest.
  [[nodiscard]] const surface::SurfaceModel &surface() const noexcept { return *surface_; }

  void apply(const NodeMotion &nodes) noexcept override;
  // Force of the skull on the brain in the last step.
  [[nodiscard]] Eigen::Vector3d force_N() const noexcept { return force_N_.cast<double>(); }

private:
  struct Support {
    int node;
    Eigen::Vector3f normal; // outward
    Eigen::Vector3f at_m;   // where the plane touches the surface, from the node at rest
    int triangle;           // triangle of the surface at that point
    bool open;              // in the craniotomy
  };
  void find_plane(Support &support, const Eigen::Vector3d &rest_mm, const Eigen::Vector3d &now_mm) const noexcept;

  SkullOptions options_;
  std::unique_ptr<surface::SurfaceModel> surface_;
  std::vector<Eigen::Vector3i> triangles_;
  std::vector<Eigen::Vector3d> nodes_mm_,
      normals_; // nodes and normals of the surface, per node of the mesh; zero inside
  std::vector<Support> supports_;
  Eigen::Vector3f force_N_ = Eigen::Vector3f::Zero();
};

} // namespace bregma::tissue
