// Wavefront OBJ: lines "v x y z" and "f a b c ...", whose corners may be "a/b/c" and count from the end if negative. A
// polygon becomes triangles. Everything else (normals, texture, groups, materials, lines) is not geometry of a surface.
#include <string>

#include "base/text.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "casefile/surface_files/text_cursor.hpp"

namespace bregma::casefile::detail {

namespace {

// The vertex of a corner, from 0.
std::optional<int> obj_corner(std::string_view word, std::size_t vertices) {
  const auto number = base::parsed_number<long long>(word.substr(0, word.find('/')));
  const auto count = static_cast<long long>(vertices);
  const long long index = number.value_or(0) > 0 ? *number - 1 : count + number.value_or(0);
  return number && *number != 0 && index >= 0 && index < count ? std::optional(static_cast<int>(index)) : std::nullopt;
}

} // namespace

Parsed<RawSurface> parse_obj(std::string_view content) {
  RawSurface out;
  out.format = "OBJ";
  std::string comments;
  int number = 0;
  for (std::string_view rest = content; !rest.empty();) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    const std::string_view line = base::trimmed(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    ++number;
    if (line.starts_with('#')) {
      comments += std::string(line) + "\n";
    }
    const bool geometry = line.size() > 1 && (line[0] == 'v' || line[0] == 'f') && (line[1] == ' ' || line[1] == '\t');
    if (!geometry) {
      continue;
    }
    TextCursor words(line.substr(2), number);
    if (line[0] == 'v') {
      const auto point = words.point("vertex " + std::to_string(out.mesh.vertices_mm.size() + 1));
      if (!point) {
        return tl::unexpected(point.error());
      }
      out.mesh.vertices_mm.push_back(*point);
      continue;
    }
    std::vector<int> corners;
    for (std::string_view word = words.word(); !word.empty(); word = words.word()) {
      const auto corner = obj_corner(word, out.mesh.vertices_mm.size());
      if (!corner) {
        return wrong_line(number, "face: corner " + in_quotes(word) + ": must be one of the " +
                                      std::to_string(out.mesh.vertices_mm.size()) + " vertices before it");
      }
      corners.push_back(*corner);
    }
    if (corners.size() < 3) {
      return wrong_line(number, "face: has " + std::to_string(corners.size()) + " corners, a face has three at least");
    }
    for (std::size_t i = 2; i < corners.size(); ++i) {
      out.mesh.triangles.emplace_back(corners[0], corners[i - 1], corners[i]);
    }
  }
  const auto space = stated_space(comments);
  if (!space) {
    return tl::unexpected(space.error());
  }
  out.space = *space;
  if (out.mesh.vertices_mm.empty()) {
    return wrong("holds no vertices");
  }
  // Nothing in the format tells whether the file is whole.
  out.notes.push_back(read_counts(out.mesh));
  note_open_end(content, out);
  return out;
}

} // namespace bregma::casefile::detail
