// Output of the readers of the single formats, before it is checked and converted to RAS mm. Private to this library.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "algorithms/surface/triangle_mesh.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile::detail {

// Place in the file, problem and value.
struct Problem {
  std::string what;
  int line = 0; // line of a text; 0 where the place is a byte, or the whole file
  std::optional<std::size_t> byte = std::nullopt;
};

template <class T> using Parsed = tl::expected<T, Problem>;

[[nodiscard]] inline tl::unexpected<Problem> wrong(std::string what) {
  return tl::unexpected<Problem>(Problem{std::move(what)});
}
[[nodiscard]] inline tl::unexpected<Problem> wrong_line(int line, std::string what) {
  return tl::unexpected<Problem>(Problem{std::move(what), line});
}
[[nodiscard]] inline tl::unexpected<Problem> wrong_byte(std::size_t byte, std::string what) {
  return tl::unexpected<Problem>(Problem{std::move(what), 0, byte});
}

// Vertices are finite and corners lie in range; units and space are still those of the file.
struct RawSurface {
  surface::TriangleMesh mesh;
  std::string format;                // "STL", ...
  std::optional<Space> space;        // stated by the file
  Space assumed_space = Space::kLps; // otherwise the space of the programs that write the format
  std::vector<std::string> notes{};  // what was applied or not; without the file's name
};

// Said where a format does not state how much there is.
[[nodiscard]] inline std::string read_counts(const surface::TriangleMesh &mesh) {
  return std::to_string(mesh.vertices_mm.size()) + " vertices and " + std::to_string(mesh.triangles.size()) +
         " triangles were read";
}

// Of a text: says so if its last line does not end, since its last number may then lack digits.
inline void note_open_end(std::string_view content, RawSurface &surface) {
  if (content.empty() || std::string_view(" \t\r\n").find(content.back()) == std::string_view::npos) {
    surface.notes.push_back("its last line does not end, it may have been cut: " + read_counts(surface.mesh));
  }
}

// The SPACE=LPS or SPACE=RAS that Slicer writes into the comments of its mesh files; a file that states both, or
// another one, is refused.
[[nodiscard]] Parsed<std::optional<Space>> stated_space(std::string_view comments);

[[nodiscard]] Parsed<RawSurface> parse_stl(std::string_view content);
[[nodiscard]] Parsed<RawSurface> parse_vtk_legacy(std::string_view content);
[[nodiscard]] Parsed<RawSurface> parse_vtk_xml(std::string_view content);
[[nodiscard]] Parsed<RawSurface> parse_gifti(std::string_view content);
[[nodiscard]] Parsed<RawSurface> parse_obj(std::string_view content);
// Both FreeSurfer formats: ASCII, and the big-endian "triangle file" that starts with FF FF FE.
[[nodiscard]] Parsed<RawSurface> parse_freesurfer(std::string_view content);

// Detected by the begin of the file; name: its file name, which decides only where the content does not.
[[nodiscard]] Parsed<RawSurface> parse_surface(std::string_view content, std::string_view name);

} // namespace bregma::casefile::detail
