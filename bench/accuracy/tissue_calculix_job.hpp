// A static indentation as a CalculiX job: the same nodes, tetrahedra, material and displacements.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::bench {

struct Indentation {
  tissue::TetMesh mesh;
  tissue::Material material; // neo-Hookean
  std::vector<int> held;     // nodes that stay
  std::vector<int> pushed;   // nodes that move
  std::function<Eigen::Vector3d(const Eigen::Vector3d &)>
      prescribed_mm; // displacement of a pushed node, by its position at rest
};

enum class CalculixElement { kC3D4, kC3D10 }; // ten nodes: mid-edge nodes are added, on straight edges

struct CalculixAnswer {
  std::vector<Eigen::Vector3d> displacement_mm;      // displacement of the mesh's own nodes
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero(); // support force on the pushed nodes
  double wall_s = 0.0;                               // time of the whole process, including files
};

[[nodiscard]] bool calculix_available();
// Files go to the folder. Throws std::runtime_error when CalculiX ends without a result.
[[nodiscard]] CalculixAnswer run_calculix(const Indentation &problem, CalculixElement element,
                                          const std::string &folder);

} // namespace bregma::bench
