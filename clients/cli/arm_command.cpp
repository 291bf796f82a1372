// `bregma arm scan | move`: motions of an arm that are checked before they are moved, and the raster of a scan as
// G-code.
#include <cmath>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/planning/arm_collision.hpp"
#include "algorithms/planning/scan_program.hpp"
#include "base/write_file.hpp"
#include "casefile/arm_files/arm_file.hpp"
#include "casefile/itk_transform.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/registration/cloud_file.hpp"

namespace bregma::cli {

namespace {

using geometry::kRadiansPerDegree;
using nlohmann::json;
using planning::ArmCollision;
using planning::PathCheck;
using planning::PathVerdict;

struct ArmArguments {
  std::string arm;
  InputFile head;
  std::string head_pose; // .tfm of the registration: from RobotBase to the head's frame
  double table_mm = 0.0;
  bool no_table = false;
  std::vector<double> sensor_mm{0.0, 0.0, 60.0}, direction{0.0, 0.0, 1.0};
  double sensor_radius_mm = 25.0;
  double guide_mm = 0.0, guide_radius_mm = 6.0;
  std::vector<double> start_deg, to_deg;
  planning::PathCheckOptions check;
  planning::RasterScan raster;
  std::vector<double> x_mm, y_mm;
  double yaw_deg = 0.0, speed_mm_s = 5.0, approach_mm = 50.0;
  std::string gcode;

  ArmArguments() { head.side = "head"; }
  [[nodiscard]] planning::MountedSensor sensor() const {
    return {Eigen::Vector3d(sensor_mm.data()), Eigen::Vector3d(direction.data()).normalized()};
  }
};

robot::JointAngles joints_of(const std::vector<double> &degrees) {
  return kRadiansPerDegree * robot::JointAngles(degrees.data());
}

std::vector<double> degrees_of(const robot::JointAngles &joints) {
  std::vector<double> out;
  for (const double rad : joints) {
    out.push_back(rad / kRadiansPerDegree);
  }
  return out;
}

const char *name_of(PathVerdict verdict) {
  switch (verdict) {
  case PathVerdict::kClear:
    return "clear";
  case PathVerdict::kNotReached:
    return "not_reached";
  case PathVerdict::kTooClose:
    return "too_close";
  case PathVerdict::kBranch:
    break;
  }
  return "branch";
}

base::Result<ArmCollision> scene_of(const ArmArguments &arguments, const robot::ArmModel &arm,
                                    std::vector<std::string> &notes) {
  planning::ArmScene scene;
  if (!arguments.no_table) {
    scene.table_z_mm = arguments.table_mm;
  }
  if (!arguments.head.path.empty()) {
    auto surface = read_surface_or_image(arguments.head);
    if (!surface) {
      return tl::unexpected(surface.error());
    }
    notes = surface->notes;
    if (!arguments.head_pose.empty()) {
      const auto T_head_base = casefile::read_itk_rigid(arguments.head_pose);
      if (!T_head_base) {
        return tl::unexpected(T_head_base.error());
      }
      const auto T_base_head = T_head_base->inverse();
      for (Eigen::Vector3d &v : surface->mesh.vertices_mm) {
        v = T_base_head * v;
      }
    } else {
      notes.push_back(arguments.head.path + ": taken as it lies in the robot's base (--head-pose)");
    }
    scene.obstacles.push_back({"head", std::move(surface->mesh)});
  }
  planning::ArmBodies bodies;
  const auto sensor = arguments.sensor();
  bodies.tools.push_back({"sensor", Eigen::Vector3d::Zero(), sensor.origin_mm, arguments.sensor_radius_mm});
  if (arguments.guide_mm > 0.0) {
    bodies.tools.push_back(
        {"guide", Eigen::Vector3d::Zero(), arguments.guide_mm * Eigen::Vector3d::UnitZ(), arguments.guide_radius_mm});
  }
  try {
    return ArmCollision(arm, std::move(bodies), scene);
  } catch (const std::invalid_argument &wrong) {
    return base::failure(wrong.what());
  }
}

json check_json(const PathCheck &check) {
  return {{"verdict", name_of(check.verdict)},
          {"accepted", check.clear()},
          {"text", check.text},
          {"length_mm", check.length_mm},
          {"at_mm", check.at_mm},
          {"nearest",
           {{"part", check.nearest.part},
            {"obstacle", check.nearest.obstacle},
            {"distance_mm", json_number(check.nearest.distance_mm)}}},
          {"bound_mm", json_number(check.bound_mm)},
          {"wrist_deg", json_number(check.wrist_rad / kRadiansPerDegree)},
          {"samples", check.samples},
          {"end_deg", degrees_of(check.end)}};
}

std::string check_text(const PathCheck &check) {
  return check.text + "\nLength " + fixed(check.length_mm, 0, "mm") + ", " + std::to_string(check.samples) +
         " samples; axes 4 and 6 at least " + fixed(check.wrist_rad / kRadiansPerDegree, 1) + " degrees apart\n";
}

int show(const PathCheck &check, json document, const std::string &details, const std::vector<std::string> &notes,
         const Context &context) {
  document.update(check_json(check));
  document["notes"] = notes;
  if (context.json) {
    print_json(document);
  } else {
    print_notes(notes);
    print(check_text(check) + details);
  }
  return check.clear() ? kOk : kRefused;
}

// The arm of this file with its inverse, or why it has none.
base::Result<robot::InverseKinematics> read_solver(const std::string &file) {
  const auto arm = casefile::read_arm(file);
  if (!arm) {
    return tl::unexpected(arm.error());
  }
  try {
    return robot::InverseKinematics(*arm);
  } catch (const std::invalid_argument &wrong) {
    return base::failure(arm->name() + ": " + wrong.what());
  }
}

base::Result<robot::JointAngles> start_of(const ArmArguments &arguments, const robot::InverseKinematics &inverse,
                                          const robot::FlangePose &first) {
  if (!arguments.start_deg.empty()) {
    const robot::JointAngles joints = joints_of(arguments.start_deg);
    if (const auto joint = inverse.model().beyond_limits(joints)) {
      return base::failure("--start-deg: joint " + std::to_string(*joint + 1) + " is beyond its limits");
    }
    return joints;
  }
  robot::JointAngles middle;
  for (std::size_t i = 0; i < robot::kJoints; ++i) {
    const robot::JointLimits &limits = inverse.model().limits()[i];
    middle[static_cast<Eigen::Index>(i)] = 0.5 * (limits.lower_rad + limits.upper_rad);
  }
  const auto solution = inverse.nearest(first, middle);
  return solution ? base::Result<robot::JointAngles>(solution->joints)
                  : base::failure("the arm does not reach the first position");
}

// A path from its start, checked among what stands around the arm.
struct CheckedPath {
  PathCheck check;
  robot::JointAngles start;
  std::vector<std::string> notes;
};
base::Result<CheckedPath> check_among(const ArmArguments &arguments, const robot::InverseKinematics &inverse,
                                      std::span<const robot::FlangePose> waypoints) {
  const auto start = start_of(arguments, inverse, waypoints.front());
  if (!start) {
    return tl::unexpected(start.error());
  }
  CheckedPath out;
  out.start = *start;
  const auto collision = scene_of(arguments, inverse.model(), out.notes);
  if (!collision) {
    return tl::unexpected(collision.error());
  }
  out.check = planning::check_path(*collision, inverse, out.start, waypoints, arguments.check);
  return out;
}

int check_scan(ArmArguments arguments, const Context &context) {
  if (auto kept = check_output("--gcode", arguments.gcode, {arguments.arm, arguments.head.path, arguments.head_pose});
      !kept) {
    return fail(kept.error());
  }
  const auto inverse = read_solver(arguments.arm);
  if (!inverse) {
    return fail(inverse.error());
  }
  arguments.raster.from_x_mm = arguments.x_mm[0];
  arguments.raster.to_x_mm = arguments.x_mm[1];
  arguments.raster.from_y_mm = arguments.y_mm[0];
  arguments.raster.to_y_mm = arguments.y_mm[1];
  arguments.raster.table_z_mm = arguments.table_mm;
  const auto corners = planning::raster_corners(arguments.raster); // throws a sentence
  std::vector<robot::FlangePose> waypoints;
  for (const Eigen::Vector3d &corner : corners) {
    waypoints.push_back(planning::flange_above(corner, arguments.sensor(), kRadiansPerDegree * arguments.yaw_deg));
  }
  const auto path = check_among(arguments, *inverse, waypoints);
  if (!path) {
    return fail(path.error());
  }
  const double seconds = planning::length_mm(corners) / arguments.speed_mm_s;
  if (path->check.clear() && !arguments.gcode.empty()) {
    const std::string program = planning::gcode(corners, arguments.speed_mm_s, arguments.approach_mm,
                                                "face scan, " + printable(inverse->model().name()));
    if (const auto written = base::write_file(arguments.gcode, program); !written) {
      return fail(written.error());
    }
  }
  json positions = json::array();
  for (const Eigen::Vector3d &corner : corners) {
    positions.push_back(json_vector(corner));
  }
  return show(path->check,
              {{"lines", corners.size() / 2},
               {"positions_mm", std::move(positions)},
               {"scan_mm", planning::length_mm(corners)},
               {"seconds", seconds},
               {"start_deg", degrees_of(path->start)}},
              std::to_string(corners.size() / 2) + " lines, " + fixed(seconds / 60.0, 1, "min") + " at " +
                  fixed(arguments.speed_mm_s, 1, "mm/s") + "\n",
              path->notes, context);
}

int check_move(const ArmArguments &arguments, const Context &context) {
  const auto inverse = read_solver(arguments.arm);
  if (!inverse) {
    return fail(inverse.error());
  }
  const robot::FlangePose to = inverse->model().forward(joints_of(arguments.to_deg));
  const auto path = check_among(arguments, *inverse, {&to, 1});
  if (!path) {
    return fail(path.error());
  }
  return show(path->check, {{"start_deg", degrees_of(path->start)}}, "", path->notes, context);
}

void add_common(CLI::App &command, ArmArguments &arguments, Context &context) {
  command.add_option("--arm", arguments.arm, "Description of the arm: .toml, .urdf or .xml")->required();
  command.add_option("--start-deg", arguments.start_deg, "Joint angles where the motion begins, deg")->expected(6);
  command.add_option("--head", arguments.head.path, "Closed surface of the head, or an image of it: an obstacle");
  command.add_option("--head-space", arguments.head.space, "Space of a file that does not state it: ras or lps")
      ->check(CLI::IsMember({"ras", "lps"}));
  command.add_option("--head-units", arguments.head.units, "Unit of the file's numbers")
      ->check(CLI::IsMember({"mm", "cm", "m", "um"}))
      ->capture_default_str();
  command.add_option("--head-pose", arguments.head_pose,
                     "Where the head lies: the .tfm that register scan writes; without it, in the robot's base");
  command.add_option("--table-mm", arguments.table_mm, "Height of the table in the robot's base")
      ->capture_default_str();
  command.add_flag("--no-table", arguments.no_table, "There is no table under the arm");
  command.add_option("--sensor-mm", arguments.sensor_mm, "Origin of the sensor's beam in the flange")->expected(3);
  command.add_option("--beam", arguments.direction, "Direction of the beam in the flange")->expected(3);
  command.add_option("--sensor-radius-mm", arguments.sensor_radius_mm, "Of the sensor's body, from the flange")
      ->check(CLI::Range(1.0, 500.0))
      ->capture_default_str();
  command.add_option("--guide-mm", arguments.guide_mm, "Length of a guide along the flange's z; 0: none")
      ->check(CLI::Range(0.0, 1000.0));
  command.add_option("--guide-radius-mm", arguments.guide_radius_mm, "Radius of the guide")
      ->check(CLI::Range(0.5, 200.0))
      ->capture_default_str();
  command.add_option("--min-distance-mm", arguments.check.min_distance_mm, "Smallest distance that is accepted")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  add_json_flag(command, context);
}

} // namespace

void add_arm_command(CLI::App &app, Context &context) {
  auto *group = app.add_subcommand("arm", "Checks motions of an arm before they are moved");
  group->require_subcommand(1);
  auto scan_arguments = std::make_shared<ArmArguments>();
  auto *scan = group->add_subcommand("scan", "A raster over a face at constant height: reach, distances, time, G-code");
  scan->add_option("--x", scan_arguments->x_mm, "From and to, along the lines, mm")->expected(2)->required();
  scan->add_option("--y", scan_arguments->y_mm, "From and to, across the lines, mm")->expected(2)->required();
  scan->add_option("--height-mm", scan_arguments->raster.height_mm, "Of the sensor above the table")
      ->check(CLI::Range(1.0, 2000.0))
      ->capture_default_str();
  scan->add_option("--line-mm", scan_arguments->raster.line_mm, "Distance of the lines")
      ->check(CLI::Range(0.1, 500.0))
      ->capture_default_str();
  scan->add_option("--yaw-deg", scan_arguments->yaw_deg, "Turn of the flange about the beam")
      ->check(CLI::Range(-360.0, 360.0));
  scan->add_option("--speed-mm-s", scan_arguments->speed_mm_s, "Speed along the lines")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  scan->add_option("--gcode", scan_arguments->gcode, "Writes the sensor's positions as a program in G-code");
  scan->add_option("--approach-mm", scan_arguments->approach_mm, "Height above the scan where the program begins")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  add_common(*scan, *scan_arguments, context);
  scan->footer(
      "Nothing is moved. The exit code is 1, and no program is written, when the arm does not reach a position\n"
      "or comes too close to something.\n\nExamples:\n"
      "  bregma arm scan --arm mz07f.toml --x 380 520 --y -80 80 --gcode scan.nc\n"
      "  bregma arm scan --arm mz07f.toml --x 380 520 --y -80 80 --head face.stl --head-space ras --json");
  scan->callback([scan_arguments, &context] {
    context.run = [scan_arguments, &context] { return check_scan(*scan_arguments, context); };
  });
  auto move_arguments = std::make_shared<ArmArguments>();
  auto *move = group->add_subcommand("move", "A straight move of the flange: reach and distances along it");
  move->add_option("--to-deg", move_arguments->to_deg, "Joint angles whose flange pose the move leads to, deg")
      ->expected(6)
      ->required();
  add_common(*move, *move_arguments, context);
  move->get_option("--start-deg")->required();
  move->footer(
      "Nothing is moved. The exit code is 1 when the arm cannot follow the line or comes too close.\n\nExample:\n"
      "  bregma arm move --arm mz07f.toml --start-deg 0 80 0 0 -60 0 --to-deg 20 80 0 0 -60 0 "
      "--head scalp.ply --head-pose robot_to_image.tfm");
  move->callback([move_arguments, &context] {
    context.run = [move_arguments, &context] { return check_move(*move_arguments, context); };
  });
}

} // namespace bregma::cli
