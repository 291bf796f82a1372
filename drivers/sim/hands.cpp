#include "drivers/sim/hands.hpp"

#include "algorithms/geometry/angles.hpp"

namespace bregma::sim {

namespace {} // namespace

Hands::Hands(std::vector<HandPose> stands, const OperatorParameters &parameters, const Patient &patient,
             std::uint64_t seed) {
  const Tremor::Strength strength{parameters.tremor_mm, parameters.tremor_deg * geometry::kRadiansPerDegree,
                                  parameters.wander_mm, parameters.wander_deg * geometry::kRadiansPerDegree};
  for (std::size_t i = 0; i < stands.size(); ++i) {
    tools_.push_back({stands[i], stands[i], nullptr, 0, Tremor(strength, seed, patient.tools[i].model.name)});
  }
}

void Hands::start(std::size_t tool, std::unique_ptr<Movement> movement, std::int64_t now_ns) {
  tools_[tool].movement = std::move(movement);
  tools_[tool].start_ns = now_ns;
}

void Hands::hold(std::size_t tool, const HandPose &pose) {
  tools_[tool].movement.reset();
  tools_[tool].rest = pose;
}

bool Hands::still(std::size_t tool, std::int64_t now_ns) const {
  const Held &held = tools_[tool];
  return !held.movement || static_cast<double>(now_ns - held.start_ns) * 1e-9 >= held.movement->duration_s();
}

HandPose Hands::meant(std::size_t tool, std::int64_t time_ns) const {
  const Held &held = tools_[tool];
  return held.movement ? held.movement->at(static_cast<double>(time_ns - held.start_ns) * 1e-9) : held.rest;
}

T_ImageTip Hands::true_tip(std::size_t tool, const HandPose &meant, std::int64_t time_ns) const {
  const HandPose pose = tools_[tool].tremor.applied(meant, static_cast<double>(time_ns - start_ns_) * 1e-9);
  return {pose.rotation, pose.tip_mm};
}

} // namespace bregma::sim
