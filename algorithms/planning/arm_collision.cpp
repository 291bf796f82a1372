#include "algorithms/planning/arm_collision.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>
#include <utility>

#include <Eigen/Geometry>

#include "algorithms/robot/straight_path.hpp"
#include "algorithms/surface/surface_model.hpp"

namespace bregma::planning {

using Eigen::Vector3d;

namespace {

constexpr std::array<const char *, robot::kJoints> kLinkNames{"column",  "upper arm", "elbow",
                                                              "forearm", "wrist",     "flange"};
constexpr double kLargestStep_rad = 0.5; // of a joint within a step: more is another branch
const std::string kTable = "table";

std::array<std::string, robot::kJoints> link_names() {
  std::array<std::string, robot::kJoints> out;
  std::copy(kLinkNames.begin(), kLinkNames.end(), out.begin());
  return out;
}

double distance_to_segment(const Vector3d &p, const Vector3d &from, const Vector3d &to) {
  const Vector3d along = to - from;
  const double squared = along.squaredNorm();
  const double t = squared > 0.0 ? std::clamp((p - from).dot(along) / squared, 0.0, 1.0) : 0.0;
  return (from + t * along - p).norm();
}

} // namespace

NamedMesh block(std::string name, const Vector3d &low_mm, const Vector3d &high_mm) {
  surface::TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.vertices_mm.emplace_back((i & 1) != 0 ? high_mm.x() : low_mm.x(), (i & 2) != 0 ? high_mm.y() : low_mm.y(),
                                  (i & 4) != 0 ? high_mm.z() : low_mm.z());
  }
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return {std::move(name), std::move(mesh)};
}

ArmCollision::ArmCollision(const robot::ArmModel &arm, ArmBodies bodies, const ArmScene &scene)
    : arm_(arm), bodies_(std::move(bodies)), table_z_mm_(scene.table_z_mm) {
  for (std::size_t i = 0; i < robot::kJoints; ++i) {
    if (!(bodies_.radius_mm[i] > 0.0)) {
      throw std::invalid_argument(std::string(kLinkNames[i]) + ": its radius must be positive");
    }
  }
  double tool_mm = 0.0;
  for (const ToolCapsule &tool : bodies_.tools) {
    if (!(tool.radius_mm > 0.0) || !tool.from_mm.allFinite() || !tool.to_mm.allFinite()) {
      throw std::invalid_argument("tool " + tool.name + ": its radius must be positive and its ends finite");
    }
    tool_mm = std::max({tool_mm, tool.from_mm.norm(), tool.to_mm.norm()});
  }
  for (const NamedMesh &mesh : scene.obstacles) {
    if (!surface::SurfaceModel(mesh.mesh).is_closed()) {
      throw std::invalid_argument("obstacle " + mesh.name + ": its mesh is not closed");
    }
    Eigen::AlignedBox3d box;
    for (const Vector3d &v : mesh.mesh.vertices_mm) {
      box.extend(v);
    }
    obstacles_.push_back({CriticalStructures({mesh}), box.center(), 0.5 * box.diagonal().norm()});
  }
  // How far the farthest point that a joint moves can be from its axis: the lengths of all links that follow.
  const auto &axes = arm_.axes_at_zero();
  double rest = tool_mm;
  for (std::size_t i = robot::kJoints; i-- > 0;) {
    const Vector3d &end = i + 1 < robot::kJoints ? axes[i + 1].point_mm : Vector3d(arm_.flange_at_zero().translation());
    rest += (end - axes[i].point_mm).norm();
    reach_mm_[i] = rest;
  }
}

std::vector<ArmCollision::Capsule> ArmCollision::capsules(const robot::JointAngles &joints) const {
  static const auto kNames = link_names();
  const auto axes = arm_.axes(joints);
  const robot::FlangePose flange = arm_.forward(joints);
  std::vector<Capsule> out;
  for (std::size_t i = 0; i < robot::kJoints; ++i) {
    out.push_back({&kNames[i], axes[i].point_mm,
                   i + 1 < robot::kJoints ? axes[i + 1].point_mm : Vector3d(flange.translation()), bodies_.radius_mm[i],
                   i == 0});
  }
  for (const ToolCapsule &tool : bodies_.tools) {
    out.push_back({&tool.name, flange * tool.from_mm, flange * tool.to_mm, tool.radius_mm, false});
  }
  return out;
}

Nearest ArmCollision::nearest(const robot::JointAngles &joints) const {
  Nearest out{"", "", std::numeric_limits<double>::infinity()};
  const auto take = [&out](const Capsule &capsule, const std::string &obstacle, double distance) {
    if (distance < out.distance_mm) {
      out = {*capsule.name, obstacle, std::max(distance, 0.0)};
    }
  };
  for (const Capsule &capsule : capsules(joints)) {
    if (table_z_mm_ && !capsule.on_table) {
      take(capsule, kTable, std::min(capsule.from.z(), capsule.to.z()) - capsule.radius - *table_z_mm_);
    }
    for (const Obstacle &obstacle : obstacles_) {
      const double least =
          distance_to_segment(obstacle.middle, capsule.from, capsule.to) - obstacle.radius - capsule.radius;
      if (least < out.distance_mm) { // otherwise even the sphere around it is farther
        const auto clearance = obstacle.mesh.path_clearance(capsule.from, capsule.to).front();
        take(capsule, clearance.name, clearance.distance_mm - capsule.radius);
      }
    }
  }
  return out;
}

double ArmCollision::moved_mm(const robot::JointAngles &from, const robot::JointAngles &to) const {
  double out = 0.0;
  for (std::size_t i = 0; i < robot::kJoints; ++i) {
    out += reach_mm_[i] * std::abs(to[static_cast<Eigen::Index>(i)] - from[static_cast<Eigen::Index>(i)]);
  }
  return out;
}

PathCheck check_path(const ArmCollision &collision, const robot::InverseKinematics &inverse,
                     const robot::JointAngles &start, std::span<const robot::FlangePose> waypoints,
                     const PathCheckOptions &options) {
  robot::StraightPath path(collision.arm().forward(start));
  for (const robot::FlangePose &waypoint : waypoints) {
    path.add(waypoint);
  }
  PathCheck out;
  out.length_mm = path.length_mm();
  out.end = start;
  out.wrist_rad = inverse.distance_to_singularity(start).wrist_rad;
  const auto settle = [&out](PathVerdict verdict, double at_mm, const std::string &what) {
    out.verdict = verdict;
    out.at_mm = at_mm;
    char place[64];
    std::snprintf(place, sizeof place, " at %.0f mm of the path", at_mm);
    out.text = what + place;
    return out;
  };
  const auto too_close = [&options](const Nearest &found) {
    char text[200];
    std::snprintf(text, sizeof text, "%s: %s comes within %.1f mm of %s (at least %.1f mm)",
                  found.distance_mm > 0.0 ? "too close" : "collision", found.part.c_str(), found.distance_mm,
                  found.obstacle.c_str(), options.min_distance_mm);
    return std::string(text);
  };
  Nearest last = collision.nearest(start);
  out.nearest = last;
  out.bound_mm = last.distance_mm;
  ++out.samples;
  if (last.distance_mm < options.min_distance_mm) {
    return settle(PathVerdict::kTooClose, 0.0, too_close(last));
  }
  double at = 0.0;
  double step = options.step_mm;
  while (at < out.length_mm) {
    const double to = std::min({at + step, out.length_mm, path.segment_end_mm(at)});
    const auto solution = inverse.nearest(path.pose(to), out.end);
    const bool may_halve = to - at > options.min_step_mm;
    if (!solution) {
      if (may_halve) {
        step = 0.5 * (to - at);
        continue;
      }
      return settle(PathVerdict::kNotReached, to, "out of reach or beyond a joint limit");
    }
    if ((solution->joints - out.end).cwiseAbs().maxCoeff() > kLargestStep_rad) {
      if (may_halve) {
        step = 0.5 * (to - at);
        continue;
      }
      return settle(PathVerdict::kBranch, to, "a joint would have to turn at once");
    }
    const Nearest here = collision.nearest(solution->joints);
    ++out.samples;
    // A point that comes from one sample and goes to the other has moved by at most this between them; it can come
    // nearer by half of what both distances do not account for.
    const double moved = collision.moved_mm(out.end, solution->joints);
    const double bound = 0.5 * (last.distance_mm + here.distance_mm - moved);
    if (here.distance_mm < out.nearest.distance_mm) {
      out.nearest = here;
    }
    if (here.distance_mm < options.min_distance_mm) {
      return settle(PathVerdict::kTooClose, to, too_close(here));
    }
    if (bound < options.min_distance_mm && may_halve) {
      step = 0.5 * (to - at);
      continue;
    }
    out.bound_mm = std::min(out.bound_mm, bound);
    out.wrist_rad = std::min(out.wrist_rad, solution->singularity.wrist_rad);
    out.end = solution->joints;
    last = here;
    at = to;
    step = std::min(options.step_mm, 2.0 * std::max(step, options.min_step_mm));
  }
  out.verdict = PathVerdict::kClear;
  out.at_mm = out.length_mm;
  char text[160];
  std::snprintf(text, sizeof text, "clear: %s stays at least %.1f mm from %s", out.nearest.part.c_str(),
                out.nearest.distance_mm, out.nearest.obstacle.c_str());
  out.text = out.nearest.part.empty() ? "clear: nothing is around the arm" : std::string(text);
  return out;
}

} // namespace bregma::planning
