// Distances to critical structures: from the tip at every frame, and from a planned line during planning.
//
// Distances are by FCL (sphere-swept bounding volumes of the meshes). Frame: Image, mm.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::planning {

struct NamedMesh {
  std::string name;
  surface::TriangleMesh mesh; // closed, outward
};

struct NearestStructure {
  int index = -1;           // -1: no structure
  double distance_mm = 0.0; // to its surface; 0 inside; NaN if there are no structures
};

struct StructurePoint {
  Eigen::Vector3d point_mm;  // of the surface
  Eigen::Vector3d direction; // unit, from it to the tip; the outward normal where the tip is on the surface or inside
};

struct StructureClearance {
  int index = -1; // in the list that the constructor received
  std::string name;
  double distance_mm = 0.0; // from the line's nearest point to the surface; 0 when the line crosses it
};

struct ClosestApproach {
  double fraction = 0.0; // of the line at which it is nearest, 0 at the entry; where it crosses, of its deepest point
  StructurePoint surface;
};

class CriticalStructures {
public:
  // Throws std::invalid_argument that names the structure and what is wrong with its mesh.
  explicit CriticalStructures(const std::vector<NamedMesh> &structures);
  ~CriticalStructures();
  CriticalStructures(CriticalStructures &&) noexcept;
  CriticalStructures &operator=(CriticalStructures &&) noexcept;

  // Result of the last query, which accelerates the next query nearby. Start with a new object.
  struct Warm {
    int index = -1;
    double distance_mm = 0.0;
    Eigen::Vector3d tip_mm = Eigen::Vector3d::Zero();
  };

  // No allocation, no exceptions; const and thread-safe, with one Warm per caller.
  [[nodiscard]] NearestStructure nearest(const Eigen::Vector3d &tip_mm, Warm &warm) const noexcept;

  // The nearest point of a structure. No allocation; thread-safe. index: as from nearest().
  [[nodiscard]] StructurePoint surface_point(int index, const Eigen::Vector3d &tip_mm) const noexcept;

  // Clearance of every structure, nearest first. Allocates: for planning, not for loops.
  [[nodiscard]] std::vector<StructureClearance> path_clearance(const Eigen::Vector3d &entry_mm,
                                                               const Eigen::Vector3d &target_mm) const;

  // Where a line comes nearest to a structure, to 0.01 mm. index: as from path_clearance().
  [[nodiscard]] ClosestApproach closest_approach(int index, const Eigen::Vector3d &entry_mm,
                                                 const Eigen::Vector3d &target_mm) const;

  [[nodiscard]] std::size_t size() const noexcept;
  [[nodiscard]] const std::string &name(int index) const;

private:
  struct Structure;
  std::vector<std::unique_ptr<Structure>> structures_;
};

} // namespace bregma::planning
