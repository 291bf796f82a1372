// Inverse kinematics in closed form, of arms whose axes 2 and 3 are parallel and whose last three axes meet in a point.
//
// Axes 1 and 2 need not meet or be perpendicular, and the axes of the wrist need not be perpendicular either. The
// problem divides into the subproblems of Paden and Kahan [Murray 1994, section 3.3]: the wrist's centre gives joint 1
// (the component along axis 2 is fixed), then joint 3 (the distance from axis 2), then joint 2; the orientation gives
// joints 5, 4 and 6. Two choices each at shoulder, elbow and wrist: up to eight branches. A Gauss-Newton step removes
// the rounding that the closed form has near a singularity.
//
// Singular poses are named: the shoulder (wrist's centre on axis 1), the elbow (stretched or folded) and the wrist
// (axes 4 and 6 in line). There one joint is free or two branches coincide; a free joint keeps the reference's angle.
//
// Pure functions; any thread; no allocation.
#pragma once

#include <cstdint>
#include <optional>

#include "algorithms/robot/arm_model.hpp"

namespace bregma::robot {

// Distance of a configuration from the singularities of the arm.
struct SingularityDistance {
  double shoulder_mm = 0.0; // lever of joint 1 at the wrist's centre along axis 2's direction
  double elbow_rad = 0.0;   // from the stretched or folded elbow
  double wrist_rad = 0.0;   // between axes 4 and 6
};

// Closer than this, an inverse solution is reported as singular.
inline constexpr SingularityDistance kSingular{0.01, 1e-5, 1e-5};

struct ArmSolution {
  JointAngles joints = JointAngles::Zero(); // each within (-pi, pi]
  SingularityDistance singularity;
  bool shoulder_singular = false, elbow_singular = false, wrist_singular = false;
  [[nodiscard]] bool singular() const { return shoulder_singular || elbow_singular || wrist_singular; }
};

enum class InverseStatus : std::uint8_t {
  kSolved,
  kTooFar,     // the wrist's centre is beyond the stretched arm
  kTooNear,    // it is nearer than the folded arm reaches
  kOutOfPlane, // no angle of joint 1 (or of joint 5) gives the required offset
  kInvalidPose // not finite
};

inline constexpr std::size_t kMaxBranches = 8;
struct InverseResult {
  InverseStatus status = InverseStatus::kInvalidPose;
  std::array<ArmSolution, kMaxBranches> solutions{}; // distinct
  std::size_t count = 0;
  double missing_mm = 0.0; // by which the nearest shoulder branch misses the arm's reach; kTooFar, kTooNear

  [[nodiscard]] std::span<const ArmSolution> all() const { return {solutions.data(), count}; }
};

class InverseKinematics {
public:
  // Throws std::invalid_argument with the reason for an arm of another kind. model is copied.
  explicit InverseKinematics(const ArmModel &model);

  // All branches, without regard to joint limits. reference: kept by joints that a singular pose leaves free.
  [[nodiscard]] InverseResult solve(const FlangePose &T_base_flange,
                                    const JointAngles &reference = JointAngles::Zero()) const;
  // The branch and the turns within the joint limits that move the joint with the longest way least; nullopt: none.
  [[nodiscard]] std::optional<ArmSolution> nearest(const FlangePose &T_base_flange, const JointAngles &reference) const;

  [[nodiscard]] SingularityDistance distance_to_singularity(const JointAngles &joints) const;
  [[nodiscard]] const ArmModel &model() const { return model_; }
  // The point where the last three axes meet, at zero angles, in RobotBase.
  [[nodiscard]] const Vector3d &wrist_centre_at_zero() const { return wrist_mm_; }

private:
  struct Shoulder {
    double q1;
    Vector3d wrist; // with joint 1 turned back
  };
  void solve_elbow(const Shoulder &shoulder, const FlangePose &wanted, const JointAngles &reference,
                   InverseResult &out) const;
  void solve_wrist(const JointAngles &first_three, const FlangePose &wanted, const JointAngles &reference,
                   InverseResult &out) const;
  void add(JointAngles joints, const FlangePose &wanted, InverseResult &out) const;

  ArmModel model_;
  Vector3d wrist_mm_;
};

} // namespace bregma::robot
