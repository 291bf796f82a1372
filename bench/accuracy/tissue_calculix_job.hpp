// A static indentation as CalculiX is asked for it: the same nodes, tetrahedra, material and displacements.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::bench {

struct Indentation {
  tissue::TetMesh mesh;
  tissue::Material material;                                             // neo-Hookean
  std::vector<int> held;                                                 // nodes that stay
  std::vector<int> pushed;                                               // nodes that move
  std::function<Eigen::Vector3d(const Eigen::Vector3d &)> prescribed_mm; // of a pushed node, by its place at rest
};

enum class CalculixElement { kC3D4, kC3D10 }; // ten nodes: mid-edge nodes are added, on straight edges

struct CalculixAnswer {
  std::vector<Eigen::Vector3d> displacement_mm;      // of the mesh's own nodes
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero(); // that holds the pushed nodes where they are
  double wall_s = 0.0;                               // of the whole process, files included
};

[[nodiscard]] bool calculix_available();
// Files go to the folder. Throws std::runtime_error when CalculiX ends without an answer.
[[nodiscard]] CalculixAnswer run_calculix(const Indentation &problem, CalculixElement element,
                                          const std::string &folder);

} // namespace bregma::bench
