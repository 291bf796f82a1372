// Arbitrary bytes as a surface file: nothing crashes or allocates more memory than the file can fill, and accepted
// surfaces are finite with corners in range.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "casefile/surface_files/raw_surface.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data), size);
  // Formats without a signature are recognized by the file name. All names are tried for every seed.
  for (const char *name : {"a.stl", "a.asc", "a.obj"}) {
    const auto surface = bregma::casefile::detail::parse_surface(content, name);
    if (!surface) {
      if (surface.error().what.empty()) {
        std::abort();
      }
      continue;
    }
    if (surface->format == "PLY") {
      continue; // its vertices are checked after reading, with all others
    }
    const auto vertices = static_cast<int>(surface->mesh.vertices_mm.size());
    for (const auto &vertex : surface->mesh.vertices_mm) {
      if (!vertex.allFinite()) {
        std::abort();
      }
    }
    for (const auto &triangle : surface->mesh.triangles) {
      if (triangle.minCoeff() < 0 || triangle.maxCoeff() >= vertices) {
        std::abort();
      }
    }
  }
  return 0;
}
