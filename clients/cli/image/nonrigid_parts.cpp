#include "clients/cli/image/nonrigid_parts.hpp"

#include <algorithm>
#include <cmath>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "casefile/volumes/displacement_file.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

constexpr double kFieldSpacing_mm = 4.0; // a fifth of the default lattice: linear interpolation is off by 0.03 mm

} // namespace

void add_nonrigid_options(CLI::App &command, NonrigidArguments &arguments, CLI::Option &excluded) {
  auto *nonrigid = command.add_flag("--nonrigid", arguments.wanted,
                                    "Also a smooth deformation (B-splines, mf-mi), from the rigid pose");
  nonrigid->excludes(&excluded);
  command.add_option("--grid-mm", arguments.grid_mm, "Edge of the deformation's cells")
      ->check(CLI::Range(4.0, 80.0))
      ->needs(nonrigid)
      ->capture_default_str();
  command.add_option("--bending", arguments.bending, "Weight of the deformation's bending, mm^2; more is smoother")
      ->check(CLI::Range(0.0, 1e6))
      ->needs(nonrigid)
      ->capture_default_str();
  command
      .add_option("--field", arguments.field,
                  "Write pose and deformation as a displacement field for ITK and Slicer (.nrrd)")
      ->needs(nonrigid);
}

intensity::NonrigidImageResult deform(const intensity::Volume &target, const intensity::Volume &source,
                                      const intensity::RigidImageOptions &options, const NonrigidArguments &arguments,
                                      const intensity::RigidImageResult &rigid, parallel::Team &team) {
  intensity::NonrigidImageOptions how;
  how.measure_options = options.measure_options;
  how.grid_mm = arguments.grid_mm;
  how.bending = arguments.bending;
  how.finest_mm = options.finest_mm;
  how.seed = options.seed;
  how.progress = options.progress;
  return intensity::register_nonrigid(target, source, rigid.T_reference_floating, how, team);
}

nlohmann::json nonrigid_json(const intensity::NonrigidImageResult &result) {
  const Eigen::Vector3d cell = result.field.spacing_mm();
  return {{"found", result.found},
          {"reason", result.reason},
          {"cell_mm", {cell.x(), cell.y(), cell.z()}},
          {"smallest_jacobian", json_number(result.jacobian.smallest)},
          {"largest_jacobian", json_number(result.jacobian.largest)},
          {"largest_displacement_mm", json_number(result.largest_mm)},
          {"mf_mi_before", json_number(result.similarity_before)},
          {"mf_mi", json_number(result.similarity)},
          {"bending_per_mm2", json_number(result.bending_per_mm2)},
          {"evaluations", result.evaluations}};
}

std::string nonrigid_text(const intensity::NonrigidImageResult &result) {
  return "\nDeformed from this pose: mf-mi " + fixed(result.similarity_before, 4) + " to " +
         fixed(result.similarity, 4) + ", up to " + fixed(result.largest_mm, 1, "mm") + ", Jacobian " +
         fixed(result.jacobian.smallest, 2) + " to " + fixed(result.jacobian.largest, 2) +
         " (no fold). Its error is not predicted: not for navigation.\n";
}

base::Result<void> write_field(const std::string &path, const image::Grid<3> &target,
                               const std::function<Eigen::Vector3d(const Eigen::Vector3d &)> &to_source) {
  casefile::DisplacementField file;
  image::Image<Eigen::Vector3f, 3> &out = file.displacement_mm;
  out.T_image_index = target.T_image_index;
  const Eigen::Vector3d spacing = target.spacing_mm();
  for (std::size_t d = 0; d < 3; ++d) {
    const auto axis = static_cast<Eigen::Index>(d);
    const double length = spacing[axis] * (target.size[d] - 1);
    const int cells = std::max(static_cast<int>(std::ceil(length / kFieldSpacing_mm)), 1);
    out.size[d] = cells + 1;
    out.T_image_index.col(axis) *= std::max(length, spacing[axis]) / spacing[axis] / cells;
  }
  out.voxels.reserve(out.pixels());
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    const Eigen::Vector3d p = out.pixel_mm(i);
    out.voxels.emplace_back((to_source(p) - p).cast<float>());
  }
  return casefile::write_displacement_field(path, file);
}

} // namespace bregma::cli
