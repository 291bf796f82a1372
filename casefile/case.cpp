#include "casefile/case.hpp"

#include <algorithm>
#include <system_error>

#include "base/table_reader.hpp"
#include "casefile/case_check.hpp"
#include "casefile/case_images.hpp"
#include "casefile/case_keys.hpp"
#include "casefile/markups.hpp"
#include "casefile/mesh_file.hpp"
#include "casefile/tissue_tables.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;

template <class Item> const Item *find_by_name(const std::vector<Item> &items, std::string_view name) {
  const auto it = std::find_if(items.begin(), items.end(), [name](const Item &item) { return item.name == name; });
  return it == items.end() ? nullptr : &*it;
}

ToolRole role_of(const std::string &name) {
  if (name == "reference") {
    return ToolRole::kReference;
  }
  return name == "probe" ? ToolRole::kProbe : ToolRole::kPointer;
}

Eigen::Vector3d direction(const Eigen::Vector3d &v) {
  // A vector that is too short to have a direction stays zero, which check_case rejects.
  return v.norm() > 1e-6 ? v.normalized() : Eigen::Vector3d::Zero();
}

ToolModel read_tool(base::TableReader &reader) {
  ToolModel tool;
  tool.name = reader.require_string("name");
  tool.role = role_of(reader.require_choice("role", {"reference", "pointer", "probe"}));
  tool.markers_mm = reader.require_vector3s("markers_mm");
  tool.normal = direction(reader.vector3("normal", tool.normal));
  tool.axis = direction(reader.vector3("axis", tool.axis));
  tool.nominal_tip_mm = reader.vector3("nominal_tip_mm", tool.nominal_tip_mm);
  static_cast<void>(reader.finish());
  return tool;
}

Limits read_limits(base::TableReader &reader) {
  Limits limits;
  const auto length = [&reader](std::string_view key, double &value, double max) {
    value = reader.number(key, value, "mm", 0.01, max);
  };
  length("fle_image_mm", limits.fle_image_mm, 10.0);
  length("fle_touch_mm", limits.fle_touch_mm, 10.0);
  length("surface_sigma_mm", limits.surface_sigma_mm, 10.0);
  length("landmark_sigma_mm", limits.landmark_sigma_mm, 10.0);
  length("max_check_mm", limits.max_check_mm, 20.0);
  length("max_target_tre_mm", limits.max_target_tre_mm, 20.0);
  static_cast<void>(reader.finish());
  return limits;
}

// Reads the files that case.toml names. The message about a faulty file starts with the line that names it.
class FileLoader {
public:
  FileLoader(const fs::path &folder, base::TableReader &root) : folder_(folder), root_(root) {}

  fs::path path(const std::string &file) const { return folder_ / file; }

  void mesh(const std::string &key, const std::string &file, surface::TriangleMesh &out) {
    take(key, good_ ? read_mesh(path(file)) : base::Result<surface::TriangleMesh>(), out);
  }
  // Appends. image: where points are placed that do not state it; empty: the planning image.
  void points(const std::string &key, const std::string &file, std::vector<NamedPoint> &out,
              const std::string &image = {}) {
    std::vector<NamedPoint> read;
    if (!file.empty()) {
      take(key, good_ ? read_points(path(file)) : base::Result<std::vector<NamedPoint>>(), read);
    }
    for (NamedPoint &point : read) {
      point.placed_in = point.placed_in.empty() ? image : point.placed_in;
      out.push_back(std::move(point));
    }
  }
  void trajectories(const std::string &key, const std::string &file, std::vector<Trajectory> &out,
                    const std::string &image = {}) {
    std::vector<Trajectory> read;
    if (!file.empty()) {
      take(key, good_ ? read_trajectories(path(file)) : base::Result<std::vector<Trajectory>>(), read);
    }
    for (Trajectory &line : read) {
      line.entry_in = line.entry_in.empty() ? image : line.entry_in;
      line.target_in = line.target_in.empty() ? image : line.target_in;
      out.push_back(std::move(line));
    }
  }
  // The transform of an image and, if it keeps one, its file, whose content must be that which was registered.
  void image(const std::string &key, const detail::ImageFiles &files, RegisteredImage &out, Checksums checksums) {
    if (good_) {
      if (auto problem = detail::load_image(folder_, files, out, checksums)) {
        root_.refuse(key + "." + problem->key, problem->what);
        good_ = false;
      }
    }
  }

private:
  template <class T> void take(const std::string &key, base::Result<T> read, T &out) {
    if (!read) {
      root_.refuse(key, read.error().message);
      good_ = false;
      return;
    }
    out = std::move(*read);
  }

  fs::path folder_;
  base::TableReader &root_;
  bool good_ = true;
};

struct PlanFiles {
  std::string scalp, brain, fiducials, landmarks, brain_landmarks, targets, trajectories;
  std::vector<std::string> structures;
  std::vector<detail::ImageFiles> images;
};

PlanFiles read_table(base::TableReader &root, Case &c) {
  PlanFiles files;
  c.id = root.require_string("id");
  c.image = root.require_string("image");
  files.fiducials = root.require_string("fiducials");
  files.landmarks = root.string("landmarks", "");
  files.brain_landmarks = root.string("brain_landmarks", "");
  files.targets = root.string("targets", "");
  files.trajectories = root.string("trajectories", "");
  if (auto surfaces = root.table("surfaces")) {
    files.scalp = surfaces->require_string("scalp");
    files.brain = surfaces->string("brain", "");
    c.brain.segmented_in = surfaces->string("brain_image", "");
    static_cast<void>(surfaces->finish());
  } else {
    root.refuse("surfaces", "is missing");
  }
  if (auto labels = root.table("labels")) {
    c.labels = LabelImage{labels->require_string("file"), labels->require_string("table")};
    static_cast<void>(labels->finish());
  }
  for (base::TableReader &structure : root.tables("structures")) {
    c.structures.push_back({structure.require_string("name"), {}});
    files.structures.push_back(structure.require_string("file"));
    c.structures.back().segmented_in = structure.string("image", "");
    static_cast<void>(structure.finish());
  }
  for (base::TableReader &image : root.tables("images")) {
    c.images.emplace_back();
    files.images.push_back(detail::read_image(image, c.images.back()));
  }
  for (base::TableReader &tool : root.tables("tools")) {
    c.tools.push_back(read_tool(tool));
  }
  if (auto limits = root.table("limits")) {
    c.limits = read_limits(*limits);
  }
  if (auto craniotomy = root.table("craniotomy")) {
    c.craniotomy = detail::read_craniotomy(*craniotomy);
  }
  if (auto tissue = root.table("tissue")) {
    c.tissue = detail::read_tissue(*tissue);
  }
  if (auto robot = root.table("robot")) {
    c.robot.emplace();
    c.robot->device = robot->require_string("device");
    c.robot->equipment_file = robot->require_string("tools");
    static_cast<void>(robot->finish());
  }
  return files;
}

// Reads the arm's equipment. What it carries are tools; its base is the reference, unless a tracker beside it sees one.
void read_robot(base::TableReader &root, Case &c) {
  CaseRobot &robot = *c.robot;
  robot.equipment_file = c.folder / robot.equipment_file;
  auto equipment = read_robot_equipment(robot.equipment_file);
  if (!equipment) {
    root.refuse("robot.tools", equipment.error().message);
    return;
  }
  robot.equipment = std::move(*equipment);
  if (const HandEyeModel *hand_eye = c.hand_eye()) {
    const ToolModel *body = c.tool(hand_eye->flange_body);
    if (!hand_eye->flange_body.empty() && (body == nullptr || body->role == ToolRole::kReference)) {
      root.refuse("tools", "the body on the flange, \"" + hand_eye->flange_body +
                               "\", must be a tool of the case, and not the reference");
    }
  } else if (!c.tools.empty()) {
    root.refuse("tools", "a case with [robot] has no [[tools]]: the arm's are in the file of robot.tools. Tracked ones "
                         "need [hand_eye] there");
  } else {
    c.tools.push_back({.name = kRobotBase, .role = ToolRole::kReference, .markers_mm = {}});
  }
  for (const RobotToolModel &tool : robot.equipment.tools) {
    c.tools.push_back({.name = tool.name,
                       .role = ToolRole::kPointer,
                       .markers_mm = {},
                       .axis = tool.axis,
                       .axis_sigma_rad = tool.sigma_rad,
                       .nominal_tip_mm = tool.tip_mm});
  }
}

} // namespace

const ToolModel *Case::tool(std::string_view name) const { return find_by_name(tools, name); }

bool Case::carried_by_arm(std::string_view name) const {
  return robot && find_by_name(robot->equipment.tools, name) != nullptr;
}

const ToolModel *Case::reference() const {
  const auto it =
      std::find_if(tools.begin(), tools.end(), [](const ToolModel &tool) { return tool.role == ToolRole::kReference; });
  return it == tools.end() ? nullptr : &*it;
}

const Trajectory *Case::trajectory(std::string_view name) const { return find_by_name(trajectories, name); }
const NamedPoint *Case::fiducial(std::string_view name) const { return find_by_name(fiducials, name); }
const NamedPoint *Case::landmark(std::string_view name) const { return find_by_name(landmarks, name); }
const RegisteredImage *Case::registered_image(std::string_view name) const { return find_by_name(images, name); }

base::Result<std::vector<ToolModel>> read_tools(const fs::path &file) {
  const auto document = base::TomlDocument::read(file);
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  std::vector<ToolModel> tools;
  for (base::TableReader &tool : root.tables("tools")) {
    tools.push_back(read_tool(tool));
  }
  if (auto whole = root.finish(); !whole) {
    return tl::unexpected(whole.error());
  }
  return tools;
}

std::vector<base::KnownKey> case_file_keys() {
  const auto document = base::TomlDocument::parse(
      "[labels]\n[surfaces]\n[[structures]]\n[[images]]\n[[tools]]\n[limits]\n[craniotomy]\n[tissue]\n[robot]\n",
      "case.toml");
  base::TableReader root = document->root();
  Case c;
  static_cast<void>(read_table(root, c));
  return document->known_keys();
}

base::Result<Case> load_case(const fs::path &folder, Checksums checksums) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    return base::failure(folder.string() + ": is not a folder; a case is a folder with case.toml");
  }
  const auto document = base::TomlDocument::read(folder / "case.toml");
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  Case c;
  c.folder = folder;
  const PlanFiles files = read_table(root, c);
  if (auto table = root.finish(); !table) {
    return tl::unexpected(table.error());
  }

  c.image = folder / c.image;
  if (!fs::exists(c.image, error)) {
    root.refuse("image", "no such file: " + c.image.string());
  }
  if (c.labels) {
    for (const auto &[key, file] : {std::pair{"labels.file", &c.labels->file}, {"labels.table", &c.labels->table}}) {
      *file = folder / *file;
      if (!fs::exists(*file, error)) {
        root.refuse(key, "no such file: " + file->string());
      }
    }
  }
  if (c.robot) {
    read_robot(root, c);
  }
  FileLoader loader(folder, root);
  c.scalp.name = "scalp";
  loader.mesh("surfaces.scalp", files.scalp, c.scalp.mesh);
  c.brain.name = "brain";
  if (!files.brain.empty()) {
    loader.mesh("surfaces.brain", files.brain, c.brain.mesh);
  }
  for (std::size_t i = 0; i < files.structures.size(); ++i) {
    loader.mesh("structures[" + std::to_string(i) + "].file", files.structures[i], c.structures[i].mesh);
  }
  for (std::size_t i = 0; i < files.images.size(); ++i) {
    loader.image("images[" + std::to_string(i) + "]", files.images[i], c.images[i], checksums);
  }
  if (auto changed =
          c.images.empty() || checksums == Checksums::kIgnore ? std::nullopt : detail::changed_planning_image(c)) {
    root.refuse(changed->key, changed->what);
  }
  loader.points("fiducials", files.fiducials, c.fiducials);
  loader.points("landmarks", files.landmarks, c.landmarks);
  loader.points("brain_landmarks", files.brain_landmarks, c.brain_landmarks);
  loader.points("targets", files.targets, c.targets);
  loader.trajectories("trajectories", files.trajectories, c.trajectories);
  for (std::size_t i = 0; i < files.images.size(); ++i) {
    const std::string key = "images[" + std::to_string(i) + "].";
    const std::string &image = c.images[i].name;
    loader.points(key + "landmarks", files.images[i].landmarks, c.landmarks, image);
    loader.points(key + "brain_landmarks", files.images[i].brain_landmarks, c.brain_landmarks, image);
    loader.points(key + "targets", files.images[i].targets, c.targets, image);
    loader.trajectories(key + "trajectories", files.images[i].trajectories, c.trajectories, image);
  }
  if (auto loaded = root.finish(); !loaded) {
    return tl::unexpected(loaded.error());
  }

  for (auto *points : {&c.landmarks, &c.brain_landmarks, &c.targets}) {
    for (NamedPoint &point : *points) {
      map_to_image(c, point);
    }
  }
  for (Trajectory &trajectory : c.trajectories) {
    map_to_image(c, trajectory);
  }
  if (auto problem = detail::find_problem(c)) {
    root.refuse(problem->key, problem->what);
    return tl::unexpected(root.finish().error());
  }
  return c;
}

base::Result<std::vector<RegisteredImage>> load_images(const fs::path &folder) {
  const auto document = base::TomlDocument::read(folder / "case.toml");
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  std::vector<RegisteredImage> out;
  for (base::TableReader &table : root.tables("images")) {
    const detail::ImageFiles files = detail::read_image(table, out.emplace_back());
    if (auto problem = detail::load_image(folder, files, out.back(), Checksums::kIgnore)) {
      table.refuse(problem->key, problem->what);
      return tl::unexpected(table.finish().error());
    }
  }
  return out;
}

} // namespace bregma::casefile
