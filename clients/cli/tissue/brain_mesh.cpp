#include "clients/cli/tissue/brain_mesh.hpp"

#include <cmath>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>
#include <nlohmann/json.hpp>

#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

std::string count_text(int count) {
  const std::string digits = std::to_string(count);
  return digits.size() <= 3 ? digits : digits.substr(0, digits.size() - 3) + "," + digits.substr(digits.size() - 3);
}

// The number of tetrahedra is proportional to the inverse cube of the edge length.
std::string edge_problem(const casefile::Case &c, double edge_mm, int count, double surface_mm3) {
  const auto edge_for = [&](int wanted) { return std::cbrt(12.0 * surface_mm3 / wanted); };
  return "--edge " + fixed(edge_mm, 2) + ": gives " + count_text(count) + " tetrahedra in the brain of " +
         c.folder.string() + "; " + count_text(kMinElements) + " to " + count_text(kMaxElements) +
         " are made, by edges of about " + fixed(edge_for(kMaxElements), 1) + " to " +
         fixed(edge_for(kMinElements), 1) + " mm";
}

} // namespace

void add_mesh_options(CLI::App &command, MeshRequest &request) {
  auto *elements = command.add_option("--elements", request.elements, "Approximate number of tetrahedra")
                       ->check(CLI::Range(kMinElements, kMaxElements))
                       ->capture_default_str();
  command.add_option("--edge", request.edge_mm, "Edge of the mesh's lattice, mm, instead of --elements")
      ->check(CLI::Range(0.5, 50.0))
      ->excludes(elements);
}

void add_entry_option(CLI::App &command, MeshRequest &request) {
  request.entry_edge_mm = case_model::BrainMeshOptions{}.entry_edge_mm;
  command
      .add_option("--entry-edge", request.entry_edge_mm, "Maximum edge where trajectories enter, mm; 0: no refinement")
      ->check(CLI::Range(0.0, 20.0))
      ->capture_default_str();
}

base::Result<case_model::Brain> fill_brain(const casefile::Case &c, const MeshRequest &request) {
  case_model::BrainSettings settings;
  settings.mesh.lattice.edge_mm = request.edge_mm;
  settings.mesh.lattice.tetrahedra = request.elements;
  settings.mesh.entry_edge_mm = request.entry_edge_mm;
  auto brain = case_model::brain_of(c, settings);
  if (brain && request.edge_mm) {
    const auto count = static_cast<int>(brain->filled.mesh.tetrahedra.size());
    if (count < kMinElements || count > kMaxElements) {
      return base::failure(edge_problem(c, *request.edge_mm, count, brain->filled.surface_mm3));
    }
  }
  return brain;
}

MeshReport report_of(const case_model::Brain &brain) {
  const tissue::LatticeMesh &filled = brain.filled;
  MeshReport out{tissue::quality_of(filled.mesh), filled.edge_mm, filled.surface_mm3, brain.material, 0.0};
  out.step_s = tissue::stable_step_s(out.quality.stable_length_mm, brain.material);
  return out;
}

std::string report_text(const MeshReport &report) {
  const tissue::MeshQuality &q = report.quality;
  Table table({"of the mesh", "value", "unit"});
  table.row({"tetrahedra", std::to_string(q.tetrahedra), ""});
  table.row({"nodes", std::to_string(q.nodes), ""});
  table.row({"nodes on the surface", std::to_string(q.boundary_nodes), ""});
  table.row({"edge of the lattice", fixed(report.edge_mm, 2), "mm"});
  table.row({"edges, shortest", fixed(q.min_edge_mm, 2), "mm"});
  table.row({"edges, longest", fixed(q.max_edge_mm, 2), "mm"});
  table.row({"volume", fixed(q.volume_mm3 / 1e3, 1), "ml"});
  table.row({"volume in the surface", fixed(report.surface_mm3 / 1e3, 1), "ml"});
  table.row({"volume, difference", fixed(100.0 * (q.volume_mm3 / report.surface_mm3 - 1.0), 2), "%"});
  table.row({"dihedral angle, smallest", fixed(q.min_dihedral_deg, 1), "deg"});
  table.row({"dihedral angle, largest", fixed(q.max_dihedral_deg, 1), "deg"});
  table.row({"radius ratio, smallest", fixed(q.min_radius_ratio, 3), ""});
  table.row({"radius ratio, 5 %", fixed(q.percentile5_radius_ratio, 3), ""});
  table.row({"radius ratio, mean", fixed(q.mean_radius_ratio, 3), ""});
  table.row({"smallest stable step", fixed(1e3 * report.step_s, 4), "ms, material " + report.material.name});
  return table.text();
}

nlohmann::json report_json(const MeshReport &report) {
  const tissue::MeshQuality &q = report.quality;
  return {{"tetrahedra", q.tetrahedra},
          {"nodes", q.nodes},
          {"surface_nodes", q.boundary_nodes},
          {"lattice_edge_mm", json_number(report.edge_mm)},
          {"min_edge_mm", json_number(q.min_edge_mm)},
          {"max_edge_mm", json_number(q.max_edge_mm)},
          {"volume_mm3", json_number(q.volume_mm3)},
          {"surface_volume_mm3", json_number(report.surface_mm3)},
          {"min_dihedral_deg", json_number(q.min_dihedral_deg)},
          {"max_dihedral_deg", json_number(q.max_dihedral_deg)},
          {"min_radius_ratio", json_number(q.min_radius_ratio)},
          {"percentile5_radius_ratio", json_number(q.percentile5_radius_ratio)},
          {"mean_radius_ratio", json_number(q.mean_radius_ratio)},
          {"material", report.material.name},
          {"stable_step_s", json_number(report.step_s)}};
}

} // namespace bregma::cli
