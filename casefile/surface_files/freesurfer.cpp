// FreeSurfer's surfaces. Their coordinates are "surface RAS" (volume_geometry.hpp). Binary files end with the geometry
// of their volume.
#include <cmath>

#include "base/text.hpp"
#include "casefile/surface_files/mesh_arrays.hpp"
#include "casefile/surface_files/number_bytes.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "casefile/surface_files/text_cursor.hpp"
#include "casefile/surface_files/volume_geometry.hpp"

namespace bregma::casefile::detail {

namespace {

constexpr std::int32_t kTagUseRealRas = 2;
constexpr std::int32_t kTagVolumeGeometry = 20;

constexpr const char *kSurfaceRas = "its points are FreeSurfer's surface RAS, and the volume's geometry is not in the "
                                    "file: they may lie elsewhere in the scanner's coordinates";

Parsed<RawSurface> ascii_freesurfer(std::string_view content) {
  RawSurface out;
  out.notes.emplace_back(kSurfaceRas);
  TextCursor cursor(content);
  if (content.starts_with('#')) {
    static_cast<void>(cursor.rest_of_line());
  }
  constexpr std::size_t kMinLineBytes = 8; // "0 0 0 0\n"
  const auto vertices = cursor.count("number of vertices", kMinLineBytes);
  const auto triangles = vertices ? cursor.count("number of triangles", kMinLineBytes) : vertices;
  if (!triangles) {
    return tl::unexpected(triangles.error());
  }
  for (std::size_t i = 0; i < *vertices; ++i) {
    const auto position = cursor.point("vertex " + std::to_string(i));
    const auto flag = position ? cursor.number("vertex " + std::to_string(i) + ": flag") : Parsed<double>(0.0);
    if (!position || !flag) {
      return tl::unexpected(position ? flag.error() : position.error());
    }
    out.mesh.vertices_mm.push_back(*position);
  }
  for (std::size_t i = 0; i < *triangles; ++i) {
    const std::string name = "triangle " + std::to_string(i);
    Eigen::Vector3i corners;
    for (int corner = 0; corner < 3; ++corner) {
      const auto index = cursor.corner(name, *vertices);
      if (!index) {
        return tl::unexpected(index.error());
      }
      corners[corner] = *index;
    }
    if (const auto flag = cursor.number(name + ": flag"); !flag) {
      return tl::unexpected(flag.error());
    }
    out.mesh.triangles.push_back(corners);
  }
  if (const auto more = cursor.word(); !more.empty()) {
    return wrong_line(cursor.line(), in_quotes(more) + " follows the triangles that it states: is it the header of "
                                                       "another surface?");
  }
  note_open_end(content, out);
  return out;
}

// "valid = 1\nfilename = ...\nxras = -1 0 0\n...cras = 5.4 18 0\n" at the end of a binary file.
Parsed<VolumeGeometry> volume_geometry(std::string_view text, std::size_t at) {
  VolumeGeometry out;
  int found = 0;
  bool stated = false;
  // Only lines that end: a line that was cut may lack digits.
  for (const std::string_view line : base::cells(text.substr(0, text.find_last_of('\n') + 1), '\n')) {
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) {
      continue;
    }
    const std::string_view key = base::trimmed(line.substr(0, equals));
    const std::string_view value = base::trimmed(line.substr(equals + 1));
    if (key == "valid") {
      stated = true;
      out.valid = value.starts_with('1');
    }
    const bool axis = key == "xras" || key == "yras" || key == "zras";
    if (!axis && key != "cras") {
      continue;
    }
    TextCursor numbers(value);
    const auto vector = numbers.point(std::string(key));
    if (!vector) {
      return wrong_byte(at, "volume geometry: " + vector.error().what);
    }
    if (axis) {
      out.axes.col(key.front() - 'x') = *vector;
    } else {
      out.centre = *vector;
    }
    ++found;
  }
  if (!stated) {
    return wrong_byte(at, "is not whole: its volume geometry ends before it begins");
  }
  if (out.valid && (found != 4 || !out.has_axes())) {
    return wrong_byte(at, "volume geometry: xras, yras and zras must be directions at right angles, and cras be there");
  }
  return out;
}

// Data after the triangles: pairs of tag and content. An unknown tag ends the search, because its length is unknown.
Parsed<VolumeGeometry> footer_geometry(std::string_view content, std::size_t at) {
  bool real_ras = false;
  while (content.size() - at >= 8) {
    const auto tag = load<std::int32_t>(content.data() + at, true);
    at += 4;
    if (tag == kTagUseRealRas) {
      real_ras = load<std::int32_t>(content.data() + at, true) != 0;
      at += 4;
    } else if (tag == kTagVolumeGeometry) {
      auto geometry = volume_geometry(content.substr(at), at);
      if (geometry && real_ras) {
        *geometry = {.valid = false, .in_scanner = true};
      }
      return geometry;
    } else {
      return VolumeGeometry{.in_scanner = real_ras};
    }
  }
  if (at != content.size()) {
    return wrong_byte(content.size(), "is not whole: it ends within its tags");
  }
  return VolumeGeometry{.in_scanner = real_ras};
}

Parsed<RawSurface> binary_freesurfer(std::string_view content) {
  const std::size_t comment_end = content.find("\n\n");
  std::size_t at = comment_end == std::string_view::npos ? content.size() : comment_end + 2;
  if (content.size() < at + 8) {
    return wrong_byte(content.size(), "the file ends within its header");
  }
  const std::size_t vertices = load<std::uint32_t>(content.data() + at, true);
  const std::size_t triangles = load<std::uint32_t>(content.data() + at + 4, true);
  at += 8;
  if (content.size() - at < 12 * (vertices + triangles)) {
    return wrong_byte(content.size(), "the file ends before its " + std::to_string(vertices) + " vertices and " +
                                          std::to_string(triangles) + " triangles do");
  }
  const auto geometry = footer_geometry(content, at + 12 * (vertices + triangles));
  if (!geometry) {
    return tl::unexpected(geometry.error());
  }
  RawSurface out;
  if (geometry->valid || geometry->in_scanner) {
    out.space = Space::kRas; // as stated: an option does not change it
  } else {
    out.notes.emplace_back(kSurfaceRas);
  }
  for (std::size_t i = 0; i < vertices; ++i) {
    Eigen::Vector3d position;
    for (Eigen::Index axis = 0; axis < 3; ++axis, at += 4) {
      position[axis] = static_cast<double>(load<float>(content.data() + at, true));
      if (!std::isfinite(position[axis])) {
        return wrong_byte(at, "vertex " + std::to_string(i) + ": " + static_cast<char>('x' + axis) + " = " +
                                  std::to_string(position[axis]) + ": must be a finite number");
      }
    }
    out.mesh.vertices_mm.push_back(geometry->valid ? geometry->scanner_ras(position) : position);
  }
  for (std::size_t i = 0; i < triangles; ++i) {
    Eigen::Vector3i corners;
    for (int corner = 0; corner < 3; ++corner, at += 4) {
      corners[corner] = load<std::int32_t>(content.data() + at, true);
      if (corners[corner] < 0 || static_cast<std::size_t>(corners[corner]) >= vertices) {
        return wrong_byte(at, "triangle " + std::to_string(i) + ": corner = " + std::to_string(corners[corner]) + ": " +
                                  range_text(vertices));
      }
    }
    out.mesh.triangles.push_back(corners);
  }
  return out;
}

} // namespace

Parsed<RawSurface> parse_freesurfer(std::string_view content) {
  auto out = content.starts_with("\xFF\xFF\xFE") ? binary_freesurfer(content) : ascii_freesurfer(content);
  if (out) {
    out->format = "FreeSurfer";
    out->assumed_space = Space::kRas;
  }
  return out;
}

} // namespace bregma::casefile::detail
