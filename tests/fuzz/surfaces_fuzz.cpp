// Arbitrary bytes as a surface file: nothing crashes or allocates more memory than the file can fill, accepted surfaces
// are finite with corners in range, and a file that is accepted is refused when it is cut, unless nothing of its
// surface is missing or the format cannot tell, which is said.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string_view>

#include "casefile/surface_files/raw_surface.hpp"

namespace {

using bregma::casefile::detail::parse_surface;
using bregma::casefile::detail::RawSurface;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

void require_valid(const RawSurface &surface) {
  if (surface.format == "PLY") {
    return; // its vertices are checked after reading, with all others
  }
  const auto vertices = static_cast<int>(surface.mesh.vertices_mm.size());
  for (const auto &vertex : surface.mesh.vertices_mm) {
    require(vertex.allFinite());
  }
  for (const auto &triangle : surface.mesh.triangles) {
    require(triangle.minCoeff() >= 0 && triangle.maxCoeff() < vertices);
  }
}

bool is_same(const RawSurface &a, const RawSurface &b) {
  // A coordinate of a PLY may be no number.
  const auto same = [](const Eigen::Vector3d &x, const Eigen::Vector3d &y) {
    return ((x.array() == y.array()) || (x.array().isNaN() && y.array().isNaN())).all();
  };
  return std::equal(a.mesh.vertices_mm.begin(), a.mesh.vertices_mm.end(), b.mesh.vertices_mm.begin(),
                    b.mesh.vertices_mm.end(), same) &&
         a.mesh.triangles == b.mesh.triangles;
}

// Their notes say how much was read, or that FreeSurfer's volume geometry is not in the file.
bool cannot_tell(const RawSurface &surface) {
  const auto said = [&surface](std::string_view text) {
    return std::any_of(surface.notes.begin(), surface.notes.end(),
                       [text](const std::string &note) { return note.find(text) != std::string::npos; });
  };
  return said("triangles were read") || said("geometry is not in the file");
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data), size);
  // Formats without a signature are recognized by the file name. All names are tried for every seed.
  for (const char *name : {"a.stl", "a.asc", "a.obj"}) {
    const auto surface = parse_surface(content, name);
    require(surface || !surface.error().what.empty());
    if (!surface) {
      continue;
    }
    require_valid(*surface);
    const std::size_t part = std::hash<std::string_view>()(content) % size;
    const auto cut = parse_surface(content.substr(0, part), name);
    require(!cut || cannot_tell(*cut) || is_same(*surface, *cut));
  }
  return 0;
}
