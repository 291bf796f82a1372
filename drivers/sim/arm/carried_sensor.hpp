// A range sensor on the simulated arm's flange, before a head that lies under the arm: its line is a pseudo-terminal.
//
// Frames: RobotBase of the true links, Image of the head; mm. Not for several threads at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "algorithms/robot/arm_model.hpp"
#include "base/result.hpp"
#include "drivers/sim/arm/moving_head.hpp"
#include "drivers/sim/head.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"
#include "drivers/sim/range_line/simulated_line.hpp"
#include "drivers/sim/terminal/pseudo_terminal.hpp"

namespace bregma::sim {

// What a beam from the flange meets: the true skin, or nothing within reach.
struct FlangeBeam {
  Vector3d origin_mm = Vector3d::Zero();
  Vector3d direction = Vector3d::UnitZ(); // unit
};
[[nodiscard]] BeamTarget beam_on_head(const Head &head, const BaseImage &T_base_image, const robot::FlangePose &flange,
                                      const FlangeBeam &beam);

// A head that lies on its back, its nose at this place, its top turned by yaw from the base's x about z.
[[nodiscard]] BaseImage lying_head(const Head &head, const Vector3d &nose_mm, double yaw_rad);

class CarriedSensor {
public:
  ~CarriedSensor();
  CarriedSensor(CarriedSensor &&) noexcept;
  CarriedSensor &operator=(CarriedSensor &&) noexcept;

  // link: the path at which the line appears; empty: its address is that of the terminal.
  [[nodiscard]] static base::Result<CarriedSensor>
  open(Head head, const FlangeBeam &beam, const range::Identity &identity, const std::string &link, std::uint64_t seed);
  [[nodiscard]] const std::string &address() const { return terminal_.address(); }
  // Answers, and the readings up to this time of a flange and a head that are here now.
  void serve(const robot::FlangePose &flange, const BaseImage &T_base_image, bool moving, std::uint64_t now_us);

private:
  struct State;
  CarriedSensor(PseudoTerminal terminal, std::unique_ptr<State> state);

  PseudoTerminal terminal_;
  std::unique_ptr<State> state_; // its address is known to the sensor
};

} // namespace bregma::sim
