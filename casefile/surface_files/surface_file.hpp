// Surfaces from other programs: PLY, STL, OBJ, VTK (legacy and .vtp), GIFTI, FreeSurfer.
//
// The result is in RAS, mm. A space that the file states (Slicer's SPACE=LPS, Bregma's own PLY) has priority. Otherwise
// the caller's `space` is used, and otherwise the convention of the programs that write the format: LPS for PLY, STL,
// OBJ and VTK (as in Slicer), RAS for GIFTI and FreeSurfer. The assumption is returned, so that it can be shown. The
// unit is mm unless the caller states another. A surface of a width that no head has is refused, with the unit that
// would explain it.
//
// All readers are our own: they refuse errors with place and value, where VTK's print a warning and return points that
// they have not read. Tests compare them with what VTK writes. Blocking; safe from any thread; nothing throws but
// std::bad_alloc.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

struct SurfaceReadOptions {
  std::optional<Space> space = std::nullopt; // for files that do not state theirs
  LengthUnit unit = LengthUnit::kMillimetre;
  SizeLimits size = kHeadSize;
  bool points_only = false;                 // a file without triangles is read too
  std::string unit_option = "another unit"; // advice in the message about a refused width, for example "--target-units"
};

struct SurfaceFile {
  surface::TriangleMesh mesh;         // RAS, mm; not empty
  std::string format;                 // "PLY", "STL", "VTK", "VTK XML", "GIFTI", "FreeSurfer"
  Space space = Space::kRas;          // coordinate system of the file
  bool space_stated = false;          // by the file itself
  std::size_t triangles_left_out = 0; // triangles that use a vertex twice
  std::vector<std::string> notes{};   // what the file states beside its points, and what was done with it
};

[[nodiscard]] base::Result<SurfaceFile> read_surface(const std::filesystem::path &file,
                                                     const SurfaceReadOptions &options = {});

} // namespace bregma::casefile
