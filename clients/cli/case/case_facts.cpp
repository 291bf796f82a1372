#include "clients/cli/case/case_facts.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <nlohmann/json.hpp>

#include "algorithms/planning/critical_structures.hpp"
#include "casefile/tissue_material.hpp"
#include "casefile/volumes/label_regions.hpp"
#include "casefile/volumes/surface.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/case/case_consistency.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

using casefile::Case;
using nlohmann::json;

// A fiducial that the operator touches must lie on the skin.
constexpr double kMaxOffScalp_mm = 3.0;
constexpr double kMinClearance_mm = 3.0;

SurfaceFacts facts_of(const casefile::Surface &surface) {
  const casefile::MeshCheck check = casefile::check_mesh(surface.mesh);
  return {surface.name, static_cast<int>(surface.mesh.vertices_mm.size()), check.volume_ml, check.area_cm2};
}

void add_points(const std::vector<casefile::NamedPoint> &points, const std::string &list, CaseFacts &facts) {
  for (const casefile::NamedPoint &point : points) {
    facts.points.push_back({point.name, list, point.position_mm, 0.0});
  }
}

void measure_to_scalp(const Case &c, CaseFacts &facts) {
  std::vector<Eigen::Vector3d> places;
  for (const PointFacts &point : facts.points) {
    places.push_back(point.position_mm);
  }
  const std::vector<Eigen::Vector3d> nearest = casefile::nearest_on_surface(c.scalp.mesh, places);
  for (std::size_t at = 0; at < nearest.size(); ++at) {
    facts.points[at].to_scalp_mm = (nearest[at] - places[at]).norm();
  }
}

// The clearance is within this of the stated one with 95 % probability.
double error_95_mm(const case_model::PathClearance &clearance) { return 1.96 * clearance.image_sigma_mm; }

std::string clearance_text(double distance_mm) {
  return distance_mm > 0.0 ? fixed(distance_mm, 1) : "0 (passes through)";
}

// Allows one voxel beyond the image, because surfaces are smoothed.
bool image_holds(const casefile::Volume &image, const surface::TriangleMesh &mesh) {
  const Eigen::Matrix4d T_index_image = image.T_image_index.inverse();
  const Eigen::Array3d last(image.size[0] - 1, image.size[1] - 1, image.size[2] - 1);
  for (const Eigen::Vector3d &vertex : mesh.vertices_mm) {
    const Eigen::Array3d index = (T_index_image * vertex.homogeneous()).head<3>().array();
    if ((index < -1.5).any() || (index > last + 1.5).any()) {
      return false;
    }
  }
  return true;
}

std::string tissue_text(const Case &c) {
  std::string out;
  if (c.craniotomy) {
    const bool by_name = !c.craniotomy->trajectory.empty();
    out += "\nCraniotomy " +
           (by_name ? "where " + c.craniotomy->trajectory + " enters the brain"
                    : "at " + vector_text(c.craniotomy->centre_mm, 1)) +
           (c.craniotomy->radius_mm ? ", radius " + fixed(*c.craniotomy->radius_mm, 1, "mm") : "") + "\n";
  }
  if (c.tissue) {
    const tissue::Material material = casefile::material_of(*c.tissue);
    out += "\nBrain of " + material.name + ": E " + fixed(material.young_Pa, 0, "Pa") + ", nu " +
           fixed(material.poisson, 3) + ", " + fixed(material.density_kg_m3, 0, "kg/m^3") + "\n";
  }
  return out;
}

json tissue_json(const Case &c) {
  json out{{"craniotomy", nullptr}, {"material", nullptr}};
  if (c.craniotomy) {
    const bool by_name = !c.craniotomy->trajectory.empty();
    out["craniotomy"] = {{"trajectory", by_name ? json(c.craniotomy->trajectory) : json(nullptr)},
                         {"centre_mm", by_name ? json(nullptr) : json_vector(c.craniotomy->centre_mm)},
                         {"radius_mm", c.craniotomy->radius_mm ? json(*c.craniotomy->radius_mm) : json(nullptr)}};
  }
  if (c.tissue) {
    const tissue::Material material = casefile::material_of(*c.tissue);
    out["material"] = {{"name", material.name},
                       {"young_Pa", material.young_Pa},
                       {"poisson", material.poisson},
                       {"density_kg_m3", material.density_kg_m3}};
  }
  return out;
}

} // namespace

CaseFacts facts_of(const Case &c) {
  CaseFacts facts;
  facts.surfaces = {facts_of(c.scalp)};
  if (!c.brain.mesh.triangles.empty()) {
    facts.surfaces.push_back(facts_of(c.brain));
  }
  std::vector<planning::NamedMesh> meshes;
  for (const casefile::Surface &structure : c.structures) {
    facts.surfaces.push_back(facts_of(structure));
    meshes.push_back({structure.name, structure.mesh});
  }
  add_points(c.fiducials, "fiducial", facts);
  add_points(c.landmarks, "landmark", facts);
  add_points(c.brain_landmarks, "brain landmark", facts);
  add_points(c.targets, "target", facts);
  measure_to_scalp(c, facts);
  const planning::CriticalStructures structures(meshes);
  for (const casefile::Trajectory &trajectory : c.trajectories) {
    facts.trajectories.push_back({trajectory.name, (trajectory.target_mm - trajectory.entry_mm).norm(),
                                  case_model::path_clearances(c, structures, trajectory)});
  }
  return facts;
}

std::string facts_text(const Case &c, const CaseFacts &facts) {
  std::string out = "Case " + c.id + ", image " + c.image.string() + ", coordinates RAS in mm\n\n";
  Table surfaces({"surface", "vertices", "volume ml", "area cm2"});
  for (const SurfaceFacts &surface : facts.surfaces) {
    surfaces.row(
        {surface.name, std::to_string(surface.vertices), fixed(surface.volume_ml, 1), fixed(surface.area_cm2, 1)});
  }
  out += surfaces.text() + "\n";
  Table points({"point", "kind", "right", "anterior", "superior", "to scalp mm"});
  for (const PointFacts &point : facts.points) {
    points.row({point.name, point.list, fixed(point.position_mm.x(), 1), fixed(point.position_mm.y(), 1),
                fixed(point.position_mm.z(), 1), fixed(point.to_scalp_mm, 1)});
  }
  out += points.text() + "\n";
  Table paths({"trajectory", "length mm", "critical structure", "clearance mm", "error of images (95 %) mm"});
  for (const TrajectoryFacts &path : facts.trajectories) {
    if (path.clearances.empty()) {
      paths.row({path.name, fixed(path.length_mm, 1), "none in the case", "-", "-"});
    }
    for (const case_model::PathClearance &clearance : path.clearances) {
      paths.row({path.name, fixed(path.length_mm, 1), clearance.structure, clearance_text(clearance.distance_mm),
                 clearance.image_sigma_mm > 0.0 ? fixed(error_95_mm(clearance), 1) : "-"});
    }
  }
  if (!paths.empty()) {
    out += paths.text() + "\n";
  }
  Table tools({"tool", "role", "markers", "nominal tip mm"});
  for (const casefile::ToolModel &tool : c.tools) {
    const char *const role = tool.role == casefile::ToolRole::kReference ? "reference"
                             : tool.role == casefile::ToolRole::kPointer ? "pointer"
                                                                         : "probe";
    tools.row({tool.name, role, std::to_string(tool.markers_mm.size()), vector_text(tool.nominal_tip_mm, 1)});
  }
  return out + tools.text() + tissue_text(c);
}

json facts_json(const Case &c, const CaseFacts &facts) {
  json out{{"id", c.id},
           {"folder", c.folder.string()},
           {"image", c.image.string()},
           {"labels", c.labels ? json(c.labels->file.string()) : json()},
           {"surfaces", json::array()},
           {"points", json::array()},
           {"trajectories", json::array()},
           {"tools", json::array()}};
  for (const SurfaceFacts &surface : facts.surfaces) {
    out["surfaces"].push_back({{"name", surface.name},
                               {"vertices", surface.vertices},
                               {"volume_ml", json_number(surface.volume_ml)},
                               {"area_cm2", json_number(surface.area_cm2)}});
  }
  for (const PointFacts &point : facts.points) {
    out["points"].push_back({{"name", point.name},
                             {"kind", point.list},
                             {"position_mm", json_vector(point.position_mm)},
                             {"to_scalp_mm", json_number(point.to_scalp_mm)}});
  }
  for (const TrajectoryFacts &path : facts.trajectories) {
    json clearances = json::array();
    for (const case_model::PathClearance &clearance : path.clearances) {
      clearances.push_back({{"structure", clearance.structure},
                            {"distance_mm", json_number(clearance.distance_mm)},
                            {"image_sigma_mm", json_number(clearance.image_sigma_mm)}});
    }
    out["trajectories"].push_back(
        {{"name", path.name}, {"length_mm", json_number(path.length_mm)}, {"clearances", std::move(clearances)}});
  }
  for (const casefile::ToolModel &tool : c.tools) {
    out["tools"].push_back({{"name", tool.name}, {"markers", tool.markers_mm.size()}});
  }
  out.update(tissue_json(c));
  return out;
}

std::vector<std::string> find_warnings(const Case &c, const CaseFacts &facts) {
  std::vector<std::string> warnings = find_inconsistencies(c);
  std::vector<std::string> said_when_made;
  if (const auto image = casefile::read_volume(c.image, {}, &said_when_made); !image) {
    warnings.push_back(image.error().message);
  } else if (!image_holds(*image, c.scalp.mesh)) {
    warnings.push_back("the scalp reaches beyond the image " + c.image.string() + ": do they belong together?");
  }
  if (c.labels) {
    if (const auto labels = casefile::read_labels(c.labels->file, {}, &said_when_made); !labels) {
      warnings.push_back(labels.error().message);
    }
    if (const auto regions = casefile::read_label_regions(c.labels->table); !regions) {
      warnings.push_back(regions.error().message);
    }
  }
  for (const PointFacts &point : facts.points) {
    const bool touched = point.list == "fiducial" || point.list == "landmark";
    if (touched && point.to_scalp_mm > kMaxOffScalp_mm) {
      warnings.push_back(point.list + " \"" + point.name + "\" lies " + fixed(point.to_scalp_mm, 1) +
                         " mm from the scalp; `bregma case snap` moves it there");
    }
  }
  for (const TrajectoryFacts &path : facts.trajectories) {
    for (const case_model::PathClearance &clearance : path.clearances) {
      const double error = error_95_mm(clearance);
      if (clearance.distance_mm - error < kMinClearance_mm) {
        warnings.push_back("trajectory \"" + path.name + "\" comes to " + fixed(clearance.distance_mm, 1) +
                           " mm of \"" + clearance.structure + "\"" +
                           (error > 0.0 ? ", +-" + fixed(error, 1) +
                                              " mm (95 %) by the registrations of the images in which they were placed"
                                        : std::string()));
      }
    }
  }
  return warnings;
}

} // namespace bregma::cli
