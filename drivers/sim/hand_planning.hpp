// Motion planning of the hand: holds a tool so that it is visible to the camera and not occluded by the head, moves
// around the head, slides over the skin. Frame: Image, mm. Const; no randomness.
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

  // A grip with the tip at the point. The shaft is as close to the skin's normal as the camera's view allows. like: the
  // previous grip, to which the new one stays close if there is a choice.
  [[nodiscard]] HandPose grip(const TrueTool &tool, const Vector3d &point, const Vector3d &normal,
                              const Quaterniond *like = nullptr) const;
  // The same grip, away from the skin.
  [[nodiscard]] HandPose stand_off(const HandPose &touch, const Vector3d &normal) const;

  // A path between two poses off the skin that does not touch the head.
  [[nodiscard]] std::unique_ptr<Movement> reach(const HandPose &from, const HandPose &to) const;

  // A path of about this length over the skin: forehead back and forth, the nose, over the top from side to side, and
  // so on. Knots about 4 mm apart, on the true skin.
  [[nodiscard]] std::vector<HandPose> scalp_path(const TrueTool &tool, double length_mm) const;

  // Stands and dimple, next to the head in the camera's view.
  [[nodiscard]] HandPose in_stand(const TrueTool &tool, std::size_t place) const;
  [[nodiscard]] HandPose in_dimple(const TrueTool &tool) const;

private:
  [[nodiscard]] double awkwardness(const TrueTool &tool, const HandPose &pose, const Vector3d &normal,
                                   const Quaterniond *like) const;
  [[nodiscard]] Vector3d beside_head(double right_mm, double down_mm) const; // in the camera's view

  const Patient *patient_;
  OperatorParameters parameters_;
};

} // namespace bregma::sim
