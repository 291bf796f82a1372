// A tetrahedral mesh with fields, for ParaView and Slicer: VTK XML unstructured grid (.vtu), appended binary.
//
// Coordinates are written in RAS, mm, and the file states this in the form that Slicer reads (field SPACE).
// Blocking; safe from any thread; nothing throws but std::bad_alloc.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "algorithms/tissue/mesh/tet_mesh.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// One row of `components` values per node or tetrahedron, row after row. The name contains the unit: "displacement_mm".
// Six components are a symmetric tensor in VTK's order: xx, yy, zz, xy, yz, xz.
struct TetField {
  std::string name;
  int components = 1; // 1, 3 or 6
  std::vector<double> values;
};

// Replaces an existing file, but only by a complete one. Refuses a mesh that tissue::check refuses, fields with a wrong
// number of values, and a name that is empty or used twice.
[[nodiscard]] base::Result<void> write_tet_mesh(const std::filesystem::path &file, const tissue::TetMesh &mesh,
                                                std::span<const TetField> node_fields = {},
                                                std::span<const TetField> cell_fields = {});

} // namespace bregma::casefile
