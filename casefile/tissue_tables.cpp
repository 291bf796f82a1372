#include "casefile/tissue_tables.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>

#include "algorithms/tissue/material/material.hpp"
#include "base/toml_values.hpp"
#include "casefile/tissue_material.hpp"

namespace bregma::casefile::detail {
namespace {

// Bone and dura lie between a craniotomy planned on the head and the brain. A larger distance means another head.
constexpr double kMaxBrainDistance_mm = 30.0;

struct Override {
  const char *key;
  std::optional<double> TissueChoice::*value;
  const char *unit;
  double min, max;
};
// Range of soft tissue. Above nu = 0.499 the solver locks.
constexpr std::array<Override, 4> kOverrides{{{"young_Pa", &TissueChoice::young_Pa, "Pa", 10.0, 1e6},
                                              {"poisson", &TissueChoice::poisson, "", 0.0, 0.499},
                                              {"density_kg_m3", &TissueChoice::density_kg_m3, "kg/m^3", 100.0, 10000.0},
                                              {"ogden_alpha", &TissueChoice::ogden_alpha, "", -50.0, 50.0}}};

std::vector<std::string> material_names() {
  std::vector<std::string> names;
  for (const tissue::Material &material : tissue::named_materials()) {
    names.push_back(material.name);
  }
  return names;
}

std::optional<CaseProblem> craniotomy_problem(const Case &c, const CraniotomyPlan &plan) {
  if (c.brain.mesh.triangles.empty()) {
    return CaseProblem{"craniotomy", "is for the tissue model, and the case has no brain (surfaces.brain)"};
  }
  if (!plan.trajectory.empty()) {
    std::string names;
    for (const Trajectory &trajectory : c.trajectories) {
      names += (names.empty() ? "\"" : ", \"") + trajectory.name + "\"";
    }
    return c.trajectory(plan.trajectory) != nullptr
               ? std::nullopt
               : std::optional(CaseProblem{"craniotomy.trajectory",
                                           "no such trajectory; " +
                                               (names.empty() ? "the case has none" : "there are " + names)});
  }
  const auto &vertices = c.brain.mesh.vertices_mm;
  const bool near = std::any_of(vertices.begin(), vertices.end(), [&](const Eigen::Vector3d &vertex) {
    return (vertex - plan.centre_mm).norm() <= kMaxBrainDistance_mm;
  });
  return near ? std::nullopt
              : std::optional(CaseProblem{"craniotomy.centre_mm",
                                          "lies more than 30 mm from the brain's surface: is it in the coordinates of "
                                          "this image (RAS)?"});
}

std::optional<CaseProblem> tissue_problem(const TissueChoice &choice) {
  const auto names = material_names();
  if (std::find(names.begin(), names.end(), choice.material) == names.end()) {
    return CaseProblem{"tissue.material", "there is no material of this name"};
  }
  if (choice.ogden_alpha && tissue::named_material(choice.material).law != tissue::Law::kOgden) {
    return CaseProblem{"tissue.ogden_alpha", "the material \"" + choice.material + "\" has no alpha"};
  }
  if (choice.ogden_alpha == 0.0) {
    return CaseProblem{"tissue.ogden_alpha", "must not be 0"};
  }
  try {
    tissue::check(material_of(choice));
  } catch (const std::invalid_argument &error) {
    return CaseProblem{"tissue", error.what()};
  }
  return std::nullopt;
}

std::string line(const char *key, const base::ParameterValue &value) {
  return std::string(key) + " = " + base::detail::to_toml_text(value) + "\n";
}

} // namespace

CraniotomyPlan read_craniotomy(base::TableReader &reader) {
  CraniotomyPlan plan;
  plan.trajectory = reader.string("trajectory", "");
  plan.centre_mm = reader.optional_vector3("centre_mm").value_or(plan.centre_mm);
  if (reader.has("trajectory") == reader.has("centre_mm")) {
    reader.refuse("centre_mm", "give either centre_mm or trajectory");
  } else if (reader.has("trajectory") && plan.trajectory.empty()) {
    reader.refuse("trajectory", "must be the name of a trajectory");
  }
  plan.radius_mm = reader.optional_number("radius_mm", "mm", 0.0, 100.0);
  static_cast<void>(reader.finish());
  return plan;
}

TissueChoice read_tissue(base::TableReader &reader) {
  TissueChoice choice;
  choice.material = reader.require_choice("material", material_names());
  for (const Override &known : kOverrides) {
    choice.*known.value = reader.optional_number(known.key, known.unit, known.min, known.max);
  }
  static_cast<void>(reader.finish());
  return choice;
}

std::string tissue_tables_text(const Case &c) {
  std::string out;
  if (c.craniotomy) {
    out += "\n# Where the skull is open: the brain is free there.\n[craniotomy]\n";
    const Eigen::Vector3d &at = c.craniotomy->centre_mm;
    out += c.craniotomy->trajectory.empty()
               ? "centre_mm = [" + base::detail::to_toml_text(at.x()) + ", " + base::detail::to_toml_text(at.y()) +
                     ", " + base::detail::to_toml_text(at.z()) + "]\n"
               : line("trajectory", c.craniotomy->trajectory);
    out += c.craniotomy->radius_mm ? line("radius_mm", *c.craniotomy->radius_mm) : "";
  }
  if (c.tissue) {
    out += "\n# Material of the brain in the tissue model.\n[tissue]\n" + line("material", c.tissue->material);
    for (const Override &known : kOverrides) {
      const std::optional<double> &value = (*c.tissue).*known.value;
      out += value ? line(known.key, *value) : "";
    }
  }
  return out;
}

std::optional<CaseProblem> tissue_tables_problem(const Case &c) {
  if (c.craniotomy) {
    if (auto problem = craniotomy_problem(c, *c.craniotomy)) {
      return problem;
    }
  }
  return c.tissue ? tissue_problem(*c.tissue) : std::nullopt;
}

} // namespace bregma::casefile::detail
