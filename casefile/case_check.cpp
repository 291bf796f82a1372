#include "casefile/case_check.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <set>

#include <Eigen/Geometry>

#include "casefile/case_images.hpp"
#include "casefile/mesh_file.hpp"
#include "casefile/tissue_tables.hpp"

namespace bregma::casefile {

namespace {

using detail::CaseProblem;
using Eigen::Vector3d;
using Problem = std::optional<CaseProblem>;

// Maximal counts and lengths, those of the DDS messages.
constexpr std::size_t kNameBytes = 31;
constexpr std::size_t kMaxTools = 12;
constexpr std::size_t kMaxMarkers = 32;
constexpr std::size_t kMaxFiducials = 64;
constexpr std::size_t kMaxTargets = 32;
constexpr std::size_t kMaxBrainLandmarks = 16;

// Markers that are nearer to one line than this determine the rotation about that line too poorly.
constexpr double kMinMarkerSpread_mm = 5.0;
// A point on the head lies near the scalp. A farther point belongs to another coordinate system or image.
constexpr double kMaxScalpDistance_mm = 30.0;
// A trajectory must end at the point for which the target's accuracy is predicted.
constexpr double kMaxTargetMismatch_mm = 1.0;
constexpr double kMinTrajectory_mm = 1.0;

std::string text(const char *format, double value) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

std::string in_quotes(const std::string &name) { return "\"" + name + "\""; }

std::optional<std::string> name_problem(const std::string &name) {
  if (name.find_first_not_of(" \t") == std::string::npos) {
    return "has no name";
  }
  if (name.size() > kNameBytes) {
    return "name " + in_quotes(name) + " has " + std::to_string(name.size()) + " bytes, at most " +
           std::to_string(kNameBytes) + " are allowed";
  }
  const bool control = std::any_of(name.begin(), name.end(), [](char c) { return static_cast<unsigned char>(c) < 32; });
  return control ? std::optional("name holds a control character") : std::nullopt;
}

template <class Item> Problem names_problem(const std::vector<Item> &items, const std::string &key, const char *item) {
  std::set<std::string> seen;
  for (std::size_t i = 0; i < items.size(); ++i) {
    const std::string which = std::string(item) + " " + std::to_string(i + 1) + " ";
    if (auto what = name_problem(items[i].name)) {
      return CaseProblem{key, which + *what};
    }
    if (!seen.insert(items[i].name).second) {
      return CaseProblem{key, which + "has the name " + in_quotes(items[i].name) + ", which is already taken"};
    }
  }
  return std::nullopt;
}

double distance_to_vertices(const surface::TriangleMesh &mesh, const Vector3d &point) {
  double best = std::numeric_limits<double>::infinity();
  for (const Vector3d &vertex : mesh.vertices_mm) {
    best = std::min(best, (vertex - point).squaredNorm());
  }
  return std::sqrt(best);
}

Problem on_head_problem(const Case &c, const std::vector<NamedPoint> &points, const std::string &key) {
  for (const NamedPoint &point : points) {
    const double distance = distance_to_vertices(c.scalp.mesh, point.position_mm);
    if (!(distance <= kMaxScalpDistance_mm)) {
      return CaseProblem{key, in_quotes(point.name) + " lies " + text("%.1f mm", distance) +
                                  " from the scalp: is it in the coordinates of this image (RAS or LPS)?"};
    }
  }
  return std::nullopt;
}

Problem box_problem(const Surface &surface, const char *called, const std::string &name, const Vector3d &point,
                    const std::string &key) {
  Eigen::AlignedBox3d box;
  for (const Vector3d &vertex : surface.mesh.vertices_mm) {
    box.extend(vertex);
  }
  if (box.contains(point)) {
    return std::nullopt;
  }
  return CaseProblem{key, in_quotes(name) + " lies outside the " + called};
}

Problem brain_landmarks_problem(const Case &c) {
  if (auto problem = names_problem(c.brain_landmarks, "brain_landmarks", "control point")) {
    return problem;
  }
  if (!c.brain_landmarks.empty() && c.brain.mesh.triangles.empty()) {
    return CaseProblem{"brain_landmarks", "the tissue model follows them, and the case has no brain (surfaces.brain)"};
  }
  if (c.brain_landmarks.size() > kMaxBrainLandmarks) {
    return CaseProblem{"brain_landmarks", "holds " + std::to_string(c.brain_landmarks.size()) + " points, at most " +
                                              std::to_string(kMaxBrainLandmarks) + " are allowed"};
  }
  for (const NamedPoint &landmark : c.brain_landmarks) {
    const auto has_its_name = [&](const NamedPoint &target) { return target.name == landmark.name; };
    if (std::any_of(c.targets.begin(), c.targets.end(), has_its_name)) {
      return CaseProblem{"brain_landmarks", in_quotes(landmark.name) + " is also a target"};
    }
    if (auto problem = box_problem(c.brain, "brain", landmark.name, landmark.position_mm, "brain_landmarks")) {
      return problem;
    }
  }
  return std::nullopt;
}

double spread_about_best_line(const std::vector<Vector3d> &points) {
  double best = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      const Vector3d direction = (points[j] - points[i]).normalized();
      double farthest = 0.0;
      for (const Vector3d &p : points) {
        farthest = std::max(farthest, direction.cross(p - points[i]).norm());
      }
      best = std::min(best, farthest);
    }
  }
  return best;
}

Problem points_problem(const Case &c) {
  if (auto problem = names_problem(c.fiducials, "fiducials", "control point")) {
    return problem;
  }
  if (c.fiducials.size() < 3 || c.fiducials.size() > kMaxFiducials) {
    return CaseProblem{"fiducials", "holds " + std::to_string(c.fiducials.size()) +
                                        " points; a registration needs 3, and at most " +
                                        std::to_string(kMaxFiducials) + " are allowed"};
  }
  if (auto problem = on_head_problem(c, c.fiducials, "fiducials")) {
    return problem;
  }
  if (auto problem = names_problem(c.landmarks, "landmarks", "control point")) {
    return problem;
  }
  for (const NamedPoint &landmark : c.landmarks) {
    if (c.fiducial(landmark.name) != nullptr) {
      return CaseProblem{"landmarks", in_quotes(landmark.name) + " is also a fiducial: a check must be independent"};
    }
  }
  if (auto problem = on_head_problem(c, c.landmarks, "landmarks")) {
    return problem;
  }
  if (auto problem = names_problem(c.targets, "targets", "control point")) {
    return problem;
  }
  if (c.targets.size() > kMaxTargets) {
    return CaseProblem{"targets", "holds " + std::to_string(c.targets.size()) + " points, at most " +
                                      std::to_string(kMaxTargets) + " are allowed"};
  }
  for (const NamedPoint &target : c.targets) {
    if (auto problem = box_problem(c.scalp, "head", target.name, target.position_mm, "targets")) {
      return problem;
    }
  }
  return brain_landmarks_problem(c);
}

Problem trajectories_problem(const Case &c) {
  if (auto problem = names_problem(c.trajectories, "trajectories", "line")) {
    return problem;
  }
  for (const Trajectory &t : c.trajectories) {
    const double length = (t.target_mm - t.entry_mm).norm();
    if (!(length >= kMinTrajectory_mm)) {
      return CaseProblem{"trajectories", in_quotes(t.name) + " is " + text("%.2f mm", length) + " long"};
    }
    const NamedPoint *nearest = nullptr;
    double distance = std::numeric_limits<double>::infinity();
    for (const NamedPoint &target : c.targets) {
      if (const double d = (target.position_mm - t.target_mm).norm(); d < distance) {
        distance = d;
        nearest = &target;
      }
    }
    if (nearest == nullptr) {
      return CaseProblem{"trajectories", in_quotes(t.name) + " has no target: the case names none"};
    }
    if (distance > kMaxTargetMismatch_mm) {
      return CaseProblem{"trajectories", in_quotes(t.name) + " ends " + text("%.1f mm", distance) +
                                             " from the nearest target, " + in_quotes(nearest->name)};
    }
  }
  return std::nullopt;
}

Problem surfaces_problem(const Case &c) {
  if (auto closed = check_closed(c.scalp.mesh); !closed) {
    return CaseProblem{"surfaces.scalp", closed.error().message};
  }
  if (!c.brain.mesh.triangles.empty()) {
    if (auto closed = check_closed(c.brain.mesh); !closed) {
      return CaseProblem{"surfaces.brain", closed.error().message};
    }
  }
  if (auto problem = names_problem(c.structures, "structures", "structure")) {
    return problem;
  }
  for (std::size_t i = 0; i < c.structures.size(); ++i) {
    if (auto closed = check_closed(c.structures[i].mesh); !closed) {
      return CaseProblem{"structures[" + std::to_string(i) + "].file", closed.error().message};
    }
  }
  return std::nullopt;
}

Problem image_names_problem(const Case &c) { return names_problem(c.images, "images", "image"); }

Problem tool_problem(const ToolModel &tool, const std::string &key) {
  const auto &markers = tool.markers_mm;
  if (!markers.empty() && (markers.size() < 3 || markers.size() > kMaxMarkers)) {
    return CaseProblem{key + ".markers_mm", "holds " + std::to_string(markers.size()) +
                                                " markers; a pose needs 3, and at most " + std::to_string(kMaxMarkers) +
                                                " are allowed"};
  }
  for (std::size_t i = 0; i < markers.size(); ++i) {
    for (std::size_t j = i + 1; j < markers.size(); ++j) {
      if ((markers[i] - markers[j]).norm() < 1.0) {
        return CaseProblem{key + ".markers_mm",
                           "markers " + std::to_string(i + 1) + " and " + std::to_string(j + 1) + " are the same"};
      }
    }
  }
  if (!markers.empty()) {
    if (const double spread = spread_about_best_line(markers); spread < kMinMarkerSpread_mm) {
      return CaseProblem{key + ".markers_mm", "the markers lie on a line (within " + text("%.1f mm", spread) +
                                                  "): the turn about it cannot be measured"};
    }
  }
  if (std::abs(tool.normal.norm() - 1.0) > 1e-6) {
    return CaseProblem{key + ".normal", "must be a direction, not zero"};
  }
  if (std::abs(tool.axis.norm() - 1.0) > 1e-6) {
    return CaseProblem{key + ".axis", "must be a direction, not zero"};
  }
  return std::nullopt;
}

Problem tools_problem(const Case &c) {
  if (auto problem = names_problem(c.tools, "tools", "tool")) {
    return problem;
  }
  if (c.tools.size() > kMaxTools) {
    return CaseProblem{"tools", std::to_string(c.tools.size()) + " tools, at most " + std::to_string(kMaxTools) +
                                    " are allowed"};
  }
  const ToolModel *reference = nullptr;
  for (std::size_t i = 0; i < c.tools.size(); ++i) {
    const std::string key = "tools[" + std::to_string(i) + "]";
    if (auto problem = tool_problem(c.tools[i], key)) {
      return problem;
    }
    if (c.tools[i].role == ToolRole::kReference) {
      if (reference != nullptr) {
        return CaseProblem{key + ".role",
                           "there is already a reference, " + in_quotes(reference->name) + "; a case has exactly one"};
      }
      reference = &c.tools[i];
    }
  }
  if (reference == nullptr) {
    return CaseProblem{"tools", "none of the tools has the role \"reference\"; a case has exactly one"};
  }
  return std::nullopt;
}

} // namespace

namespace detail {

std::optional<CaseProblem> find_problem(const Case &c) {
  const bool good_id =
      !c.id.empty() && c.id.size() <= kNameBytes && c.id.find_first_of(" \t\n/\\\"") == std::string::npos;
  if (!good_id) {
    return CaseProblem{"id",
                       "must be 1 to " + std::to_string(kNameBytes) + " bytes without blanks, slashes and quotes"};
  }
  for (const auto check : {surfaces_problem, image_names_problem, detail::images_problem, points_problem,
                           trajectories_problem, tools_problem, detail::tissue_tables_problem}) {
    if (auto problem = check(c)) {
      return problem;
    }
  }
  return std::nullopt;
}

} // namespace detail

base::Result<void> check_case(const Case &c) {
  if (auto problem = detail::find_problem(c)) {
    return base::failure("case \"" + c.id + "\": " + problem->key + ": " + problem->what);
  }
  return {};
}

} // namespace bregma::casefile
