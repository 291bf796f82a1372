#include "casefile/surface_files/surface_file.hpp"

#include <algorithm>
#include <cmath>

#include "base/read_file.hpp"
#include "base/text.hpp"
#include "casefile/ply.hpp"
#include "casefile/surface_files/raw_surface.hpp"

namespace bregma::casefile {

namespace detail {

namespace {

Parsed<RawSurface> parse_ply_surface(std::string_view content) {
  const std::string_view header = content.substr(0, content.find("end_header"));
  const auto space = stated_space(header);
  if (!space) {
    return tl::unexpected(space.error());
  }
  auto mesh = parse_ply(content);
  if (!mesh) {
    return wrong(mesh.error());
  }
  const bool ours = header.find("comment Bregma: RAS") != std::string_view::npos;
  RawSurface out{std::move(*mesh), "PLY", ours ? std::optional(Space::kRas) : *space, Space::kLps};
  if (header.find("format ascii") != std::string_view::npos) {
    note_open_end(content, out);
  }
  return out;
}

} // namespace

Parsed<std::optional<Space>> stated_space(std::string_view comments) {
  constexpr std::string_view kKey = "SPACE=";
  const auto is_letter = [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' || c == '-';
  };
  std::optional<Space> out;
  for (std::size_t at = comments.find(kKey); at != std::string_view::npos; at = comments.find(kKey, at + 1)) {
    if (at > 0 && is_letter(comments[at - 1])) { // such as COLORSPACE=sRGB
      continue;
    }
    const std::string_view rest = comments.substr(at + kKey.size());
    const auto end = std::find_if_not(rest.begin(), rest.end(), is_letter);
    const std::string word(rest.begin(), end);
    const auto space = space_named(word);
    if (!space) {
      return wrong("SPACE=" + word.substr(0, 40) + ": must be RAS or LPS");
    }
    if (out && *out != *space) {
      return wrong("states both SPACE=LPS and SPACE=RAS");
    }
    out = space;
  }
  return out;
}

Parsed<RawSurface> parse_surface(std::string_view content, std::string_view file_name) {
  const std::string name = base::lower(file_name);
  const std::string_view start = content.substr(0, 4096);
  const auto has = [&start](std::string_view word) { return start.find(word) != std::string_view::npos; };
  if (start.starts_with("ply")) {
    return parse_ply_surface(content);
  }
  if (start.starts_with("# vtk DataFile")) {
    return parse_vtk_legacy(content);
  }
  if (start.starts_with("\xFF\xFF\xFE") || start.starts_with("#!ascii")) {
    return parse_freesurfer(content);
  }
  if (has("<GIFTI")) {
    return parse_gifti(content);
  }
  if (has("<VTKFile")) {
    return parse_vtk_xml(content);
  }
  if (name.ends_with(".stl")) {
    return parse_stl(content);
  }
  if (name.ends_with(".obj")) {
    return parse_obj(content);
  }
  if (name.ends_with(".asc") || name.ends_with(".srf")) {
    return parse_freesurfer(content);
  }
  return wrong("is not a surface that is read: PLY, STL, OBJ, VTK (.vtk, .vtp), GIFTI or FreeSurfer");
}

} // namespace detail

namespace {

std::string message_of(const std::filesystem::path &file, const detail::Problem &problem) {
  const std::string place = problem.line > 0 ? ":" + std::to_string(problem.line)
                            : problem.byte   ? ": byte " + std::to_string(*problem.byte)
                                             : "";
  return file.string() + place + ": " + problem.what;
}

// Final check after all readers, needed for PLY: finite coordinates and corners in range. A triangle that contains a
// vertex twice has no area and is dropped.
std::string clean(surface::TriangleMesh &mesh, bool points_only, std::size_t &left_out) {
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      if (const double value = mesh.vertices_mm[i][axis]; !std::isfinite(value)) {
        return "vertex " + std::to_string(i) + ": " + static_cast<char>('x' + axis) + " = " + std::to_string(value) +
               ": must be a finite number";
      }
    }
  }
  const auto vertices = static_cast<int>(mesh.vertices_mm.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (const int corner : mesh.triangles[i]) {
      if (corner < 0 || corner >= vertices) {
        return "triangle " + std::to_string(i) + ": corner = " + std::to_string(corner) + ": must be a vertex, 0 to " +
               std::to_string(vertices - 1);
      }
    }
  }
  left_out = std::erase_if(mesh.triangles,
                           [](const Eigen::Vector3i &t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; });
  return mesh.triangles.empty() && !points_only
             ? "the mesh is empty: it has " + std::to_string(vertices) + " vertices and no triangle"
             : "";
}

} // namespace

base::Result<SurfaceFile> read_surface(const std::filesystem::path &file, const SurfaceReadOptions &options) {
  const auto content = base::read_file(file);
  if (!content) {
    return tl::unexpected(content.error());
  }
  auto raw = detail::parse_surface(*content, file.filename().string());
  if (!raw) {
    return base::failure(message_of(file, raw.error()));
  }
  SurfaceFile out;
  if (const auto problem = clean(raw->mesh, options.points_only, out.triangles_left_out); !problem.empty()) {
    return base::failure(file.string() + ": " + problem);
  }
  out.mesh = std::move(raw->mesh);
  out.format = std::move(raw->format);
  for (const std::string &note : raw->notes) {
    out.notes.push_back(file.string() + ": " + note);
  }
  out.space_stated = raw->space.has_value();
  out.space = raw->space.value_or(options.space.value_or(raw->assumed_space));
  for (Eigen::Vector3d &vertex : out.mesh.vertices_mm) {
    vertex *= mm_per(options.unit);
    vertex = out.space == Space::kLps ? flipped(vertex) : vertex;
  }
  if (const auto problem =
          size_problem(out.mesh.vertices_mm, options.size, options.unit, "the surface", options.unit_option);
      !problem.empty()) {
    return base::failure(file.string() + ": " + problem);
  }
  return out;
}

} // namespace bregma::casefile
