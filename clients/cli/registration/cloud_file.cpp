#include "clients/cli/registration/cloud_file.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <utility>

#include "base/text.hpp"
#include "casefile/point_table.hpp"
#include "casefile/volumes/surface.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/case/progress_line.hpp"

namespace bregma::cli {

namespace {

constexpr std::array kImageExtensions{".nii", ".nii.gz", ".hdr",  ".img", ".img.gz", ".mgh",
                                      ".mgz", ".nrrd",   ".nhdr", ".mha", ".mhd"};

bool is_point_list(const std::string &name) {
  const std::string lower = base::lower(name);
  return casefile::is_point_table(name) || lower.ends_with(".json") || lower.ends_with(".fcsv");
}

bool is_image(const std::string &name) {
  std::error_code ignored;
  const std::string lower = base::lower(name);
  return std::filesystem::is_directory(name, ignored) ||
         std::any_of(kImageExtensions.begin(), kImageExtensions.end(),
                     [&lower](const char *extension) { return lower.ends_with(extension); });
}

std::vector<std::string> notes_of(const InputFile &file, const casefile::SurfaceFile &surface) {
  std::vector<std::string> out = surface.notes;
  if (!surface.space_stated) {
    out.push_back(file.path + " (" + surface.format + ") does not say its space: taken as " +
                  std::string(casefile::name_of(surface.space)) + " (--" + file.side + "-space)");
  } else if (file.stated_space() && *file.stated_space() != surface.space) {
    out.push_back(file.path + " states its space, which has priority over --" + file.side + "-space");
  }
  if (surface.triangles_left_out > 0) {
    out.push_back(file.path + ": " + std::to_string(surface.triangles_left_out) +
                  " triangles without area are left out");
  }
  return out;
}

// Detects a closed mesh from a program that orients its triangles inwards.
void turn_outward(surface::TriangleMesh &mesh) {
  const casefile::MeshCheck check = casefile::check_mesh(mesh);
  if (check.closed && check.volume_ml < 0.0) {
    for (Eigen::Vector3i &triangle : mesh.triangles) {
      std::swap(triangle[1], triangle[2]);
    }
  }
}

} // namespace

base::Result<Cloud> read_cloud(const InputFile &file, const casefile::SizeLimits &size) {
  Cloud out;
  if (is_point_list(file.path)) {
    auto read = read_point_file(file.path, file.point_options(size));
    if (!read) {
      return tl::unexpected(read.error());
    }
    for (const casefile::NamedPoint &point : read->points) {
      out.points_mm.push_back(point.position_mm);
    }
    out.notes = std::move(read->notes);
  } else {
    casefile::SurfaceReadOptions options = file.surface_options(size);
    options.points_only = true;
    auto read = casefile::read_surface(file.path, options);
    if (!read) {
      return tl::unexpected(read.error());
    }
    out.notes = notes_of(file, *read);
    out.points_mm = std::move(read->mesh.vertices_mm);
  }
  return out;
}

base::Result<Surface> read_surface_or_image(const InputFile &file) {
  if (!is_image(file.path)) {
    auto read = casefile::read_surface(file.path, file.surface_options());
    if (!read) {
      return tl::unexpected(read.error());
    }
    turn_outward(read->mesh);
    return Surface{std::move(read->mesh), notes_of(file, *read)};
  }
  std::vector<std::string> notes;
  const auto image = casefile::read_volume(file.path, {.space = file.stated_space()}, &notes);
  if (!image) {
    return tl::unexpected(image.error());
  }
  ProgressLine progress;
  auto scalp = casefile::extract_surface(*image, casefile::scalp_options(), [&](double done, std::string_view stage) {
    return progress.show(done, "scalp: " + std::string(stage));
  });
  if (!scalp) {
    return base::failure(file.path + ": " + scalp.error().message);
  }
  const auto problem = casefile::size_problem(scalp->mesh.vertices_mm, casefile::kHeadSize,
                                              casefile::LengthUnit::kMillimetre, "the scalp", "");
  if (!problem.empty()) {
    return base::failure(file.path + ": " + problem);
  }
  notes.push_back(file.path + ": its scalp has " + std::to_string(scalp->mesh.vertices_mm.size()) + " vertices");
  return Surface{std::move(scalp->mesh), std::move(notes)};
}

} // namespace bregma::cli
