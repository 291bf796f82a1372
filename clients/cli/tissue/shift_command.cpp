#include "clients/cli/tissue/shift_command.hpp"
#include "clients/cli/case/case_output.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>

#include "algorithms/tissue/brain_shift.hpp"
#include "algorithms/tissue/mesh/tet_locator.hpp"
#include "casefile/tissue_files/tet_file.hpp"
#include "clients/cli/case/progress_line.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/tissue/brain_mesh.hpp"

namespace bregma::cli {
namespace {

using base::failure;
using base::Result;
using Eigen::Vector3d;

// Direction of gravity per posture of the head (RAS).
const std::map<std::string, Vector3d> &postures() {
  static const std::map<std::string, Vector3d> kAll{{"supine", -Vector3d::UnitY()},
                                                    {"prone", Vector3d::UnitY()},
                                                    {"left-down", -Vector3d::UnitX()},
                                                    {"right-down", Vector3d::UnitX()},
                                                    {"sitting", -Vector3d::UnitZ()}};
  return kAll;
}

struct ShiftOptions {
  std::string folder;
  std::string posture = "supine", imaged = "supine";
  std::optional<double> fluid_drop_mm; // default: to the lowest edge of the craniotomy
  double gap_mm = 0.0;
  bool without_falx = false;
  MeshRequest mesh;
  std::string vtu; // empty: not written
};

struct MovedPoint {
  std::string name, kind;
  bool inside = false; // inside the mesh; otherwise its displacement is unknown
  Vector3d displacement_mm = Vector3d::Zero();
};

struct ShiftOfCase {
  tissue::TetMesh mesh;
  tissue::Material material;
  tissue::BrainShift shift;
  std::vector<MovedPoint> points; // targets and brain landmarks
};

std::vector<MovedPoint> moved_points(const casefile::Case &c, const tissue::TetMesh &mesh,
                                     const tissue::BrainShift &shift) {
  const tissue::TetLocator locator(mesh);
  std::vector<MovedPoint> out;
  const auto add = [&](const std::vector<casefile::NamedPoint> &points, const char *kind) {
    for (const casefile::NamedPoint &point : points) {
      const tissue::MaterialPoint at = locator.locate(point.position_mm);
      MovedPoint moved{point.name, kind, at.inside()};
      if (moved.inside) {
        moved.displacement_mm =
            locator.place(at, [&](int node) { return shift.displacement_mm[static_cast<std::size_t>(node)]; });
      }
      out.push_back(std::move(moved));
    }
  };
  add(c.targets, "target");
  add(c.brain_landmarks, "landmark");
  return out;
}

Result<ShiftOfCase> run_model(const ShiftOptions &options) {
  ProgressLine progress;
  const auto goes_on = [&](double done, const char *stage) { return progress.show(done, stage); };
  if (!goes_on(0.0, "case")) {
    return failure("stopped");
  }
  const auto loaded = casefile::load_case(options.folder);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  if (!goes_on(0.1, "tetrahedra")) {
    return failure("stopped");
  }
  auto brain = fill_brain(*loaded, options.mesh);
  if (!brain) {
    return tl::unexpected(brain.error());
  }
  if (!goes_on(0.4, "brain shift")) {
    return failure("stopped");
  }
  tissue::BrainShiftOptions how;
  how.material = brain->material;
  how.solver.threads = 2;
  how.skull.gap_mm = options.gap_mm;
  how.falx = !options.without_falx;
  how.skull.craniotomy = brain->craniotomy;
  how.gravity = postures().at(options.posture);
  how.gravity_imaged = postures().at(options.imaged);
  how.fluid_drop_mm = options.fluid_drop_mm;
  try {
    ShiftOfCase out{std::move(brain->filled.mesh), how.material, {}, {}};
    out.shift = tissue::predict_shift(out.mesh, how);
    out.points = moved_points(*loaded, out.mesh, out.shift);
    return goes_on(1.0, "brain shift") ? Result<ShiftOfCase>(std::move(out)) : failure("stopped");
  } catch (const std::invalid_argument &error) {
    return failure(options.folder + ": " + error.what());
  }
}

Result<void> write_displacement(const std::string &file, const ShiftOfCase &moved) {
  casefile::TetField displacement{"displacement_mm", 3, {}};
  for (const Vector3d &u : moved.shift.displacement_mm) {
    displacement.values.insert(displacement.values.end(), {u.x(), u.y(), u.z()});
  }
  const casefile::TetField fields[] = {std::move(displacement)};
  return casefile::write_tet_mesh(file, moved.mesh, fields, {});
}

nlohmann::json vector_json(const Vector3d &v) { return {json_number(v.x()), json_number(v.y()), json_number(v.z())}; }

nlohmann::json place_json(const tissue::ShiftedPoint &point) {
  if (point.node < 0) {
    return nullptr;
  }
  return {{"rest_mm", vector_json(point.rest_mm)}, {"displacement_mm", vector_json(point.displacement_mm)}};
}

nlohmann::json shift_json(const ShiftOfCase &moved, const ShiftOptions &options) {
  const bool answered = moved.shift.relaxation.converged; // else nothing of it may be used: null
  nlohmann::json points = nlohmann::json::array();
  for (const MovedPoint &point : moved.points) {
    points.push_back(
        {{"name", point.name},
         {"kind", point.kind},
         {"displacement_mm", answered && point.inside ? vector_json(point.displacement_mm) : nlohmann::json()}});
  }
  const tissue::BrainShift &shift = moved.shift;
  return {{"elements", moved.mesh.tetrahedra.size()},
          {"material", moved.material.name},
          {"posture", options.posture},
          {"imaged", options.imaged},
          {"falx", !options.without_falx},
          {"fluid_drop_mm", json_number(shift.fluid_drop_mm)},
          {"converged", shift.relaxation.converged},
          {"steps", shift.relaxation.steps},
          {"residual", json_number(shift.relaxation.residual)},
          {"inverted_elements", shift.inverted_elements},
          {"surface", answered ? place_json(shift.surface) : nlohmann::json()},
          {"deep", answered ? place_json(shift.deep) : nlohmann::json()},
          {"points", std::move(points)}};
}

std::string shift_text(const ShiftOfCase &moved, const ShiftOptions &options) {
  const tissue::BrainShift &shift = moved.shift;
  std::string out = "Head " + options.posture + ", imaged " + options.imaged + "; fluid " +
                    fixed(shift.fluid_drop_mm, 1, "mm") + " below the brain's highest point; " +
                    std::to_string(moved.mesh.tetrahedra.size()) + " tetrahedra of " + moved.material.name + "\n\n";
  if (!shift.relaxation.converged) {
    return out + "NO ANSWER: the tissue did not come to rest in " + std::to_string(shift.relaxation.steps) +
           " steps.\n";
  }
  Table table({"moves", "kind", "by mm", "right", "anterior", "superior"});
  const auto row = [&](const std::string &name, const std::string &kind, const Vector3d &u) {
    table.row({name, kind, fixed(u.norm(), 1), fixed(u.x(), 1), fixed(u.y(), 1), fixed(u.z(), 1)});
  };
  if (shift.surface.node >= 0) {
    row("surface", "farthest", shift.surface.displacement_mm);
  }
  if (shift.deep.node >= 0) {
    row("deeper than 3 cm", "farthest", shift.deep.displacement_mm);
  }
  for (const MovedPoint &point : moved.points) {
    if (point.inside) {
      row(point.name, point.kind, point.displacement_mm);
    } else {
      table.row({point.name, point.kind, "not in the brain", "", "", ""});
    }
  }
  out += table.text();
  out += options.vtu.empty() ? "" : "\nWritten: " + options.vtu + "\n";
  return out + "\nA model without " + (options.without_falx ? "falx, " : "") +
         "tentorium and vessels; docs/tissue.md states its limits.\n";
}

int run_shift(const ShiftOptions &options, const Context &context) {
  if (auto kept = check_output_of_case("--vtu", options.vtu, options.folder); !kept) {
    return fail(kept.error());
  }
  const auto moved = run_model(options);
  if (!moved) {
    return fail(moved.error());
  }
  const bool answered = moved->shift.relaxation.converged;
  if (answered && !options.vtu.empty()) {
    if (auto written = write_displacement(options.vtu, *moved); !written) {
      return fail(written.error());
    }
  }
  if (context.json) {
    print_json(shift_json(*moved, options));
  } else {
    print(shift_text(*moved, options));
  }
  return answered ? kOk : kRefused;
}

} // namespace

void add_shift_command(CLI::App &group, Context &context) {
  auto options = std::make_shared<ShiftOptions>();
  auto *command =
      group.add_subcommand("shift", "Predicts how the case's brain sinks when fluid has drained from the opened skull");
  std::vector<std::string> names;
  for (const auto &[name, down] : postures()) {
    names.push_back(name);
  }
  command->add_option("folder", options->folder, "Case folder")->required();
  command->add_option("--posture", options->posture, "Posture of the head")
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  command->add_option("--imaged", options->imaged, "Posture of the head when the image was taken")
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  command
      ->add_option("--fluid-drop", options->fluid_drop_mm,
                   "Fluid level below the brain's highest point, mm\n"
                   "(default: to the lowest edge of the case's craniotomy)")
      ->check(CLI::Range(0.0, 200.0));
  command->add_option("--gap", options->gap_mm, "Gap of fluid between brain and skull, mm")
      ->check(CLI::Range(0.0, 20.0))
      ->capture_default_str();
  command->add_flag("--no-falx", options->without_falx, "Leave out the fold of dura between the hemispheres");
  add_mesh_options(*command, options->mesh);
  command->add_option("--vtu", options->vtu, "Write the displacements to this file");
  add_json_flag(*command, context);
  command->footer("The exit code is 1 when the tissue did not come to rest: there is no result then.\n\n"
                  "Examples:\n  bregma tissue shift colin27\n"
                  "  bregma tissue shift colin27 --posture left-down --fluid-drop 40 --vtu shift.vtu");
  command->callback(
      [options, &context] { context.run = [options, &context] { return run_shift(*options, context); }; });
}

} // namespace bregma::cli
