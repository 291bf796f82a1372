// The mesh of a case's brain by command-line options, with a report of its quality.
#pragma once

#include <optional>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "algorithms/tissue/mesh/lattice_mesh.hpp"
#include "algorithms/tissue/mesh/mesh_quality.hpp"
#include "case_model/brain.hpp"
#include "casefile/case.hpp"

namespace CLI {
class App;
}

namespace bregma::cli {

// Fewer elements do not resolve a brain's surface, more cannot be stepped in real time.
inline constexpr int kMinElements = 10'000;
inline constexpr int kMaxElements = 100'000;

struct MeshRequest {
  int elements = 20'000;         // approximate number
  std::optional<double> edge_mm; // edge of the lattice, instead of elements
  double entry_edge_mm = 0.0;    // maximum edge where trajectories enter; 0: no refinement
};

// --elements and --edge, which exclude each other. The request must outlive the command.
void add_mesh_options(CLI::App &command, MeshRequest &request);
// --entry-edge, with the daemon's default.
void add_entry_option(CLI::App &command, MeshRequest &request);

// Blocks for about a second. Refuses an edge that gives fewer or more tetrahedra than the limits, and states the range
// of edges.
[[nodiscard]] base::Result<case_model::Brain> fill_brain(const casefile::Case &c, const MeshRequest &request);

struct MeshReport {
  tissue::MeshQuality quality;
  double edge_mm = 0.0;     // edge of the lattice
  double surface_mm3 = 0.0; // volume inside the brain's surface
  tissue::Material material;
  double step_s = 0.0; // maximum stable step in this material
};

[[nodiscard]] MeshReport report_of(const case_model::Brain &brain);
[[nodiscard]] std::string report_text(const MeshReport &report);
[[nodiscard]] nlohmann::json report_json(const MeshReport &report);

} // namespace bregma::cli
