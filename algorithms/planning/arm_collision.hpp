// Distances of an arm, and of what it carries, from what stands around it; and the check of a path before it is moved.
//
// The arm is a chain of capsules between the axes of its joints, and the tools are capsules in the flange. Obstacles
// are closed meshes and the table. Distances to meshes are by FCL (critical_structures.hpp). The column at the arm's
// base stands on the table and is not compared with it. Capsules of the arm are not compared with each other.
//
// A path is checked along its whole length, not only at samples: between two samples no point of the arm moves farther
// than the joints' changes times their reach, so the distance cannot fall below what both samples and this bound allow.
// Where that is not enough, the samples are set closer.
//
// Frame: RobotBase, mm, rad. Const after construction, any thread; allocates.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algorithms/planning/critical_structures.hpp"
#include "algorithms/robot/inverse_kinematics.hpp"

namespace bregma::planning {

// A part that the flange carries, such as a sensor or a guide.
struct ToolCapsule {
  std::string name;
  Eigen::Vector3d from_mm = Eigen::Vector3d::Zero(), to_mm = Eigen::Vector3d::Zero(); // in RobotFlange
  double radius_mm = 0.0;
};

struct ArmBodies {
  // Of the column, upper arm, elbow, forearm, wrist and flange: between the axes of joints 1 and 2, 2 and 3, ..., 6 and
  // the flange.
  std::array<double, robot::kJoints> radius_mm{100.0, 80.0, 75.0, 65.0, 55.0, 45.0};
  std::vector<ToolCapsule> tools;
};

struct ArmScene {
  std::vector<NamedMesh> obstacles; // closed, outward
  std::optional<double> table_z_mm; // everything below is the table; nullopt: there is none
};
// A block with edges along the axes, as an obstacle.
[[nodiscard]] NamedMesh block(std::string name, const Eigen::Vector3d &low_mm, const Eigen::Vector3d &high_mm);

struct Nearest {
  std::string part, obstacle; // empty: nothing is compared
  double distance_mm = 0.0;   // 0: they touch; infinite without obstacles
};

class ArmCollision {
public:
  // Throws std::invalid_argument that names the body or obstacle: a radius that is not positive, a mesh that is not
  // closed.
  ArmCollision(const robot::ArmModel &arm, ArmBodies bodies, const ArmScene &scene);

  [[nodiscard]] Nearest nearest(const robot::JointAngles &joints) const;
  // No point of the arm moves by more between the two, if the joints turn evenly.
  [[nodiscard]] double moved_mm(const robot::JointAngles &from, const robot::JointAngles &to) const;
  [[nodiscard]] const robot::ArmModel &arm() const { return arm_; }

private:
  struct Capsule {
    const std::string *name;
    Eigen::Vector3d from, to;
    double radius;
    bool on_table; // the column
  };
  struct Obstacle {
    CriticalStructures mesh;
    Eigen::Vector3d middle;
    double radius; // of the sphere around it
  };
  [[nodiscard]] std::vector<Capsule> capsules(const robot::JointAngles &joints) const;

  robot::ArmModel arm_;
  ArmBodies bodies_;
  std::vector<Obstacle> obstacles_;
  std::optional<double> table_z_mm_;
  std::array<double, robot::kJoints> reach_mm_{}; // of each joint
};

struct PathCheckOptions {
  double min_distance_mm = 10.0;
  double step_mm = 10.0;     // largest, along the path
  double min_step_mm = 0.25; // no closer samples
};

enum class PathVerdict : std::uint8_t {
  kClear,
  kNotReached, // out of reach, or beyond a joint limit
  kTooClose,
  kBranch // the arm would have to change its configuration within a step
};

struct PathCheck {
  PathVerdict verdict = PathVerdict::kNotReached;
  std::string text; // with the place
  double length_mm = 0.0;
  double at_mm = 0.0;    // where the path fails; its length if it does not
  Nearest nearest;       // of all samples
  double bound_mm = 0.0; // below this no distance is, along the whole path
  robot::JointAngles end = robot::JointAngles::Zero();
  double wrist_rad = 0.0; // smallest angle between axes 4 and 6
  std::size_t samples = 0;
  [[nodiscard]] bool clear() const { return verdict == PathVerdict::kClear; }
};

// Straight lines of the flange from where the joints are, over the waypoints (robot/straight_path.hpp).
[[nodiscard]] PathCheck check_path(const ArmCollision &collision, const robot::InverseKinematics &inverse,
                                   const robot::JointAngles &start, std::span<const robot::FlangePose> waypoints,
                                   const PathCheckOptions &options = {});

} // namespace bregma::planning
