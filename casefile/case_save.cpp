#include <algorithm>
#include <cctype>
#include <set>
#include <system_error>

#include "base/toml_values.hpp"
#include "base/write_file.hpp"
#include "casefile/case.hpp"
#include "casefile/case_images.hpp"
#include "casefile/markups.hpp"
#include "casefile/mesh_file.hpp"
#include "casefile/tissue_tables.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;

std::string text(const std::string &value) { return base::detail::to_toml_text(value); }
std::string number(double value) { return base::detail::to_toml_text(value); }

std::string vector(const Eigen::Vector3d &v) {
  return "[" + number(v.x()) + ", " + number(v.y()) + ", " + number(v.z()) + "]";
}

const char *role_text(ToolRole role) {
  switch (role) {
  case ToolRole::kReference:
    return "reference";
  case ToolRole::kPointer:
    return "pointer";
  case ToolRole::kProbe:
    break;
  }
  return "probe";
}

// Relative to the case's folder if it is inside.
std::string file_text(const Case &c, const fs::path &file) {
  const fs::path relative = file.lexically_relative(c.folder);
  const bool inside = !relative.empty() && *relative.begin() != "..";
  return text((inside ? relative : file).generic_string());
}

std::string labels_text(const Case &c) {
  return !c.labels ? ""
                   : "\n# Regions as an image of their numbers, with their names and colours: for "
                     "displays.\n[labels]\nfile = " +
                         file_text(c, c.labels->file) + "\ntable = " + file_text(c, c.labels->table) + "\n";
}

std::string robot_text(const Case &c) {
  return "\n# An arm, and the file of what it carries.\n[robot]\ndevice = " + text(c.robot->device) +
         "\ntools = " + file_text(c, c.robot->equipment_file) + "\n";
}

std::string tool_text(const ToolModel &tool) {
  std::string out =
      "\n[[tools]]\nname = " + text(tool.name) + "\nrole = \"" + role_text(tool.role) + "\"\nmarkers_mm = [\n";
  for (const auto &marker : tool.markers_mm) {
    out += "  " + vector(marker) + ",\n";
  }
  return out + "]\nnormal = " + vector(tool.normal) + "\naxis = " + vector(tool.axis) +
         "\nnominal_tip_mm = " + vector(tool.nominal_tip_mm) + "\n";
}

std::string limits_text(const Limits &limits) {
  return "\n# 1-sigma errors per coordinate, and limits of a registration.\n[limits]\nfle_image_mm = " +
         number(limits.fle_image_mm) + "\nfle_touch_mm = " + number(limits.fle_touch_mm) +
         "\nsurface_sigma_mm = " + number(limits.surface_sigma_mm) +
         "\nlandmark_sigma_mm = " + number(limits.landmark_sigma_mm) +
         "\nmax_check_mm = " + number(limits.max_check_mm) +
         "\nmax_target_tre_mm = " + number(limits.max_target_tre_mm) + "\n";
}

// Runs the steps until one fails.
class Steps {
public:
  template <class Step> void run(Step step) {
    if (result_) {
      result_ = step();
    }
  }
  [[nodiscard]] const base::Result<void> &result() const { return result_; }

private:
  base::Result<void> result_;
};

} // namespace

namespace detail {

std::string file_stem(const std::string &name, std::set<std::string> &taken) {
  std::string stem;
  for (const char c : name) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) != 0 && static_cast<unsigned char>(c) < 128;
    stem += plain ? static_cast<char>(std::tolower(static_cast<unsigned char>(c))) : '_';
  }
  std::string unique = stem;
  for (int i = 2; !taken.insert(unique).second; ++i) {
    unique = stem + "_" + std::to_string(i);
  }
  return unique;
}

} // namespace detail

base::Result<void> save_case(const Case &c) {
  std::error_code error;
  fs::create_directories(c.folder / "surfaces", error);
  if (error) {
    return base::failure((c.folder / "surfaces").string() + ": cannot be made: " + error.message());
  }
  std::string toml = "id = " + text(c.id) + "\nimage = " + file_text(c, c.image) + "\n\n# Slicer markups.\n";
  Steps steps;
  const auto points = [&](const std::string &name, const std::vector<NamedPoint> &list) {
    toml += name + " = " + text(name + ".mrk.json") + "\n";
    steps.run(
        [&] { return write_points(c.folder / (name + ".mrk.json"), name, detail::placed_in_planning_image(list)); });
  };
  points("fiducials", c.fiducials);
  points("landmarks", c.landmarks);
  if (!c.brain_landmarks.empty()) {
    points("brain_landmarks", c.brain_landmarks);
  }
  points("targets", c.targets);
  toml += "trajectories = \"trajectories.mrk.json\"\n";
  steps.run([&] { return write_trajectories(c.folder / "trajectories.mrk.json", detail::written_with_the_plan(c)); });

  toml += labels_text(c);
  toml += "\n# Closed surfaces, coordinates RAS in mm.\n[surfaces]\nscalp = \"surfaces/scalp.ply\"\n";
  steps.run([&] { return write_mesh(c.folder / "surfaces/scalp.ply", c.scalp.mesh); });
  if (!c.brain.mesh.triangles.empty()) {
    toml += "brain = \"surfaces/brain.ply\"\n";
    toml += c.brain.segmented_in.empty() ? "" : "brain_image = " + text(c.brain.segmented_in) + "\n";
    steps.run([&] { return write_mesh(c.folder / "surfaces/brain.ply", c.brain.mesh); });
  }
  std::set<std::string> taken{"scalp", "brain"};
  for (const Surface &structure : c.structures) {
    const std::string file = "surfaces/" + detail::file_stem(structure.name, taken) + ".ply";
    toml += "\n[[structures]]\nname = " + text(structure.name) + "\nfile = " + text(file) + "\n";
    toml += structure.segmented_in.empty() ? "" : "image = " + text(structure.segmented_in) + "\n";
    steps.run([&] { return write_mesh(c.folder / file, structure.mesh); });
  }
  steps.run([&] { return detail::save_images(c).map([&toml](const std::string &tables) { toml += tables; }); });
  for (const ToolModel &tool : c.tools) {
    if (!c.carried_by_arm(tool.name) && !c.arm_alone()) { // an arm's tools are in their own file
      toml += tool_text(tool);
    }
  }
  toml += c.robot ? robot_text(c) : std::string();
  toml += limits_text(c.limits) + detail::tissue_tables_text(c);
  steps.run([&] { return base::write_file(c.folder / "case.toml", toml); });
  return steps.result();
}

} // namespace bregma::casefile
