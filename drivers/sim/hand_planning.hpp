// What a person does without thinking: hold a tool so that the camera sees it and the head is not in the way, reach
// around the head, slide over the skin. Frame: Image, mm. Const; no randomness.
#pragma once

#include <memory>
#include <vector>

#include "drivers/sim/motion.hpp"
#include "drivers/sim/patient.hpp"
#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

class HandPlanning {
public:
  HandPlanning(const Patient &patient, const OperatorParameters &parameters)
      : patient_(&patient), parameters_(parameters) {}

  // A grip with the tip at the point: the shaft leans from the skin's normal as little as the camera's view allows.
  // like: the grip before, which is kept to where there is a choice.
  [[nodiscard]] HandPose grip(const TrueTool &tool, const Vector3d &point, const Vector3d &normal,
                              const Quaterniond *like = nullptr) const;
  // The same grip, away from the skin.
  [[nodiscard]] HandPose stand_off(const HandPose &touch, const Vector3d &normal) const;

  // A way between two poses off the skin that keeps clear of the head.
  [[nodiscard]] std::unique_ptr<Movement> reach(const HandPose &from, const HandPose &to) const;

  // A way of about this length over the skin: forehead to and fro, the nose, over the top from side to side, and so
  // on. Knots about 4 mm apart, on the true skin.
  [[nodiscard]] std::vector<HandPose> scalp_path(const TrueTool &tool, double length_mm) const;

  // Stands and dimple: beside the head as the camera sees it.
  [[nodiscard]] HandPose in_stand(const TrueTool &tool, std::size_t place) const;
  [[nodiscard]] HandPose in_dimple(const TrueTool &tool) const;

private:
  [[nodiscard]] double awkwardness(const TrueTool &tool, const HandPose &pose, const Vector3d &normal,
                                   const Quaterniond *like) const;
  [[nodiscard]] Vector3d beside_head(double right_mm, double down_mm) const; // as the camera sees it

  const Patient *patient_;
  OperatorParameters parameters_;
};

} // namespace bregma::sim
