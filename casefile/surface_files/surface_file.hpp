// Surfaces from other programs: PLY, STL, VTK (legacy and .vtp), GIFTI, FreeSurfer.
//
// The result is in RAS, mm. Where the file states its space (Slicer's SPACE=LPS, Bregma's own PLY) that holds. Where it
// does not, the caller's `space` does, and else what the programs mean that write the format: LPS for PLY, STL and VTK
// (as Slicer takes them), RAS for GIFTI and FreeSurfer. What was assumed is told, so that it can be shown. The unit is
// mm unless the caller knows better; a surface of a width that no head has is refused, with the unit that would explain
// it.
//
// All readers are our own: they refuse what is wrong with its place in the file and the value, where VTK's print a
// warning and hand over points that they have not read. Tests hold them against what VTK writes. Blocking; safe from
// any thread; nothing throws but std::bad_alloc.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

struct SurfaceReadOptions {
  std::optional<Space> space = std::nullopt; // for files that do not state theirs
  LengthUnit unit = LengthUnit::kMillimetre;
  SizeLimits size = kHeadSize;
  std::string unit_option = "another unit"; // what a refused width advises, for example "--target-units"
};

struct SurfaceFile {
  surface::TriangleMesh mesh;         // RAS, mm; not empty
  std::string format;                 // "PLY", "STL", "VTK", "VTK XML", "GIFTI", "FreeSurfer"
  Space space = Space::kRas;          // of the file
  bool space_stated = false;          // by the file itself
  std::size_t triangles_left_out = 0; // which had a vertex twice
};

[[nodiscard]] base::Result<SurfaceFile> read_surface(const std::filesystem::path &file,
                                                     const SurfaceReadOptions &options = {});

} // namespace bregma::casefile
