// STL, ASCII and binary: three corners per triangle. Corners at equal positions become one vertex.
#include <array>
#include <cmath>
#include <cstring>
#include <unordered_map>
#include <utility>

#include "base/text.hpp"
#include "casefile/surface_files/number_bytes.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "casefile/surface_files/text_cursor.hpp"

namespace bregma::casefile::detail {

namespace {

constexpr std::size_t kStlHeader = 80;
constexpr std::size_t kStlStart = kStlHeader + 4; // after the number of triangles
constexpr std::size_t kStlTriangle = 50;          // normal, three corners, two bytes of attributes

// Merges corners at exactly the same position. STL repeats a vertex for each of its triangles.
class VertexMerger {
public:
  explicit VertexMerger(surface::TriangleMesh &mesh) : mesh_(mesh) {}

  int index_of(const Eigen::Vector3d &position) {
    const std::array<double, 3> key{position.x() + 0.0, position.y() + 0.0, position.z() + 0.0}; // no negative zero
    const auto [entry, fresh] = known_.try_emplace(key, static_cast<int>(mesh_.vertices_mm.size()));
    if (fresh) {
      mesh_.vertices_mm.push_back(position);
    }
    return entry->second;
  }

private:
  struct Hash {
    std::size_t operator()(const std::array<double, 3> &key) const {
      std::size_t out = 0;
      for (const double value : key) {
        out = (out ^ std::hash<double>()(value)) * 0x9E3779B97F4A7C15ULL;
      }
      return out ^ (out >> 32U);
    }
  };
  surface::TriangleMesh &mesh_;
  std::unordered_map<std::array<double, 3>, int, Hash> known_;
};

Parsed<void> expect_word(TextCursor &cursor, std::string_view expected) {
  const std::string_view found = cursor.word();
  if (base::lower(found) != expected) {
    return wrong_line(cursor.line(), found.empty()
                                         ? "the file ends where \"" + std::string(expected) + "\" must stand"
                                         : in_quotes(found) + " where \"" + std::string(expected) + "\" is expected");
  }
  return {};
}

// The words between `facet` and `endfacet`.
Parsed<Eigen::Vector3i> ascii_facet(TextCursor &cursor, const std::string &name, VertexMerger &vertices) {
  if (auto normal = expect_word(cursor, "normal"); !normal) {
    return tl::unexpected(normal.error());
  }
  for (int axis = 0; axis < 3; ++axis) {
    static_cast<void>(cursor.word()); // not needed, and programs write "nan" for triangles without area
  }
  for (const char *word : {"outer", "loop"}) {
    if (auto read = expect_word(cursor, word); !read) {
      return tl::unexpected(read.error());
    }
  }
  Eigen::Vector3i corners;
  for (int corner = 0; corner < 3; ++corner) {
    if (auto read = expect_word(cursor, "vertex"); !read) {
      return tl::unexpected(read.error());
    }
    const auto position = cursor.point(name + ": corner " + std::to_string(corner));
    if (!position) {
      return tl::unexpected(position.error());
    }
    corners[corner] = vertices.index_of(*position);
  }
  for (const char *word : {"endloop", "endfacet"}) {
    if (auto read = expect_word(cursor, word); !read) {
      return tl::unexpected(read.error());
    }
  }
  return corners;
}

Parsed<RawSurface> ascii_stl(std::string_view content) {
  RawSurface out;
  VertexMerger vertices(out.mesh);
  TextCursor cursor(content);
  bool ended = false;
  while (true) {
    const std::string_view found = cursor.word();
    if (found.empty()) {
      break;
    }
    const std::string word = base::lower(found); // some programs write capitals
    ended = word == "endsolid";
    if (word == "solid" || word == "endsolid") {
      const auto space = stated_space(cursor.rest_of_line());
      if (!space) {
        return tl::unexpected(space.error());
      }
      out.space = *space ? *space : out.space;
      continue;
    }
    if (word != "facet") {
      return wrong_line(cursor.line(), in_quotes(found) + " where \"facet\" or \"endsolid\" is expected");
    }
    const auto corners = ascii_facet(cursor, "triangle " + std::to_string(out.mesh.triangles.size()), vertices);
    if (!corners) {
      return tl::unexpected(corners.error());
    }
    out.mesh.triangles.push_back(*corners);
  }
  return ended ? Parsed<RawSurface>(std::move(out))
               : wrong_line(cursor.line(), "is not whole: it ends before endsolid");
}

Parsed<RawSurface> binary_stl(std::string_view content) {
  if (content.size() < kStlStart) {
    return wrong_byte(content.size(), "the file ends within its header of 84 bytes");
  }
  const auto count = load<std::uint32_t>(content.data() + kStlHeader, false);
  const std::size_t there = (content.size() - kStlStart) / kStlTriangle;
  if (there < count) {
    return wrong_byte(content.size(),
                      "the file ends in triangle " + std::to_string(there) + " of " + std::to_string(count));
  }
  if (there > count) {
    return wrong_byte(kStlStart + count * kStlTriangle, "holds " + std::to_string(there - count) +
                                                            " triangles more than its header states: is it the header "
                                                            "of another surface?");
  }
  RawSurface out;
  if (const std::size_t behind = content.size() - kStlStart - count * kStlTriangle; behind > 0) {
    out.notes.push_back(std::to_string(behind) + " bytes behind its triangles are not read");
  }
  const auto space = stated_space(content.substr(0, kStlHeader));
  if (!space) {
    return tl::unexpected(space.error());
  }
  out.space = *space;
  VertexMerger vertices(out.mesh);
  for (std::size_t i = 0; i < count; ++i) {
    Eigen::Vector3i corners;
    for (std::size_t corner = 0; corner < 3; ++corner) {
      Eigen::Vector3d position;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t at = kStlStart + i * kStlTriangle + 4 * (3 + 3 * corner + axis);
        const auto value = static_cast<double>(load<float>(content.data() + at, false));
        if (!std::isfinite(value)) {
          return wrong_byte(at, "triangle " + std::to_string(i) + ": corner " + std::to_string(corner) + ": " +
                                    static_cast<char>('x' + axis) + " = " + std::to_string(value) +
                                    ": must be a finite number");
        }
        position[static_cast<Eigen::Index>(axis)] = value;
      }
      corners[static_cast<Eigen::Index>(corner)] = vertices.index_of(position);
    }
    out.mesh.triangles.push_back(corners);
  }
  return out;
}

// An ASCII file begins with "solid", but some programs begin the header of binary files with it as well.
bool is_binary_stl(std::string_view content) {
  if (base::lower(content.substr(0, 5)) != "solid") {
    return true;
  }
  return content.size() >= kStlStart &&
         (content.size() - kStlStart) == kStlTriangle * load<std::uint32_t>(content.data() + kStlHeader, false);
}

} // namespace

Parsed<RawSurface> parse_stl(std::string_view content) {
  auto out = is_binary_stl(content) ? binary_stl(content) : ascii_stl(content);
  if (out) {
    out->format = "STL";
  }
  return out;
}

} // namespace bregma::casefile::detail
