// A six-axis arm next to the head that holds the biopsy guide at its flange.
//
// The joints follow the guide's desired pose by damped least squares [Wampler 1986]. Joints and flange are consistent:
// the reported flange pose follows from the joints, including encoder noise. Base: z up in the room (anterior of the
// supine patient). Flange: z towards the head, along the guide. mm, rad, ns.
#pragma once

#include <array>
#include <cstdint>

#include "drivers/sim/patient.hpp"
#include "drivers/sim/random.hpp"
#include "idl/topics.hpp"

namespace bregma::sim {

using T_ImageFlange = geometry::Rigid3<frame::Image, frame::RobotFlange>;
using T_BaseFlange = geometry::Rigid3<frame::RobotBase, frame::RobotFlange>;

class RobotArm {
public:
  static constexpr int kJoints = 6;
  using Joints = Eigen::Matrix<double, kJoints, 1>;

  // Parked above the head, directed at its centre.
  RobotArm(const Patient &patient, const RobotParameters &parameters, std::uint64_t seed);

  // Moves to the pose on a smooth path that starts now. Another call, before or after the end, changes the goal.
  void go(const T_ImageFlange &goal, std::int64_t now_ns);
  void shift_goal(const T_ImageFlange &goal) { goal_ = goal; }
  [[nodiscard]] bool arrived(std::int64_t now_ns) const { return now_ns >= arrival_ns_; }
  // Flange z along the direction, with the smallest rotation from the current pose.
  [[nodiscard]] T_ImageFlange looking(const Vector3d &position, const Vector3d &direction) const;

  // Times must not decrease.
  [[nodiscard]] wire::RobotState sample(std::int64_t time_ns);
  // Pose of the flange at the last sample.
  [[nodiscard]] const T_ImageFlange &flange() const { return T_image_flange_; }

  [[nodiscard]] static T_BaseFlange forward(const Joints &joints);
  // False if the pose is out of reach; the joints are then the closest solution found.
  [[nodiscard]] static bool inverse(const T_BaseFlange &wanted, Joints &joints);

private:
  [[nodiscard]] T_ImageFlange wanted(std::int64_t time_ns) const;

  RobotParameters parameters_;
  geometry::Rigid3<frame::Image, frame::RobotBase> T_image_base_;
  T_ImageFlange from_, goal_, T_image_flange_;
  std::int64_t departure_ns_ = 0;
  std::int64_t arrival_ns_ = 0;
  Joints joints_ = Joints::Zero();
  std::int64_t last_sample_ns_ = 0;
  bool reachable_ = true;
  Random noise_;
};

} // namespace bregma::sim
