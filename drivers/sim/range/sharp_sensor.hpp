// A simulated infrared range sensor of the kind of [NeuroGuide]: Sharp's analogue triangulating sensor for 10 to 80 cm,
// read by an analogue-to-digital converter. It is not the model that the calibration and the filters assume.
//
// - The voltage falls with the distance along the data sheet's typical curve, monotone cubic between its points. Below
//   about 65 mm it falls again, so that near surfaces look far.
// - The sensor measures for one period, then holds the value for the next: 38.3 +- 9.6 ms each.
// - The spot has a width: at an edge the voltage is a mixture, not the distance of either side. A tilted surface reads
//   too far.
// - Spikes of one period, noise of the converter, more of it while the robot moves, steps of 4.9 mV.
//
// Deterministic for a seed. One thread at a time.
#pragma once

#include <cstdint>
#include <functional>
#include <numbers>

#include "drivers/sim/random.hpp"

namespace bregma::sim {

struct SharpOptions {
  double period_ms = 38.3, period_spread_ms = 9.6; // uniform
  double noise_mV = 5.0;                           // of each period's value
  double line_noise_mV = 2.0;                      // of each reading
  double moving_noise_mV = 12.0;                   // of each reading, in addition, while the robot moves
  double step_mV = 5000.0 / 1024.0;
  double spike_probability = 0.01; // per period
  double spike_mV = 300.0;         // largest
  double tilt_bias_mm = 3.5;       // times sin(tilt)^2
  double tilt_uneven = 0.5;        // more or less of it, by the cosine of the azimuth: the sensor looks from one side
  double edge_weight = 0.5;        // of the second surface in the spot, at an edge
};

// What the beam meets: the distance along it, the tilt of the surface there, and a second distance if the spot lies on
// an edge (NaN: it does not). The azimuth begins at the sensor's baseline.
struct BeamTarget {
  double distance_mm = 0.0;
  double tilt_rad = 0.0;
  double other_mm = 0.0;
  double azimuth_rad = 0.5 * std::numbers::pi; // of the surface's normal, about the beam
};
using BeamTargetAt = std::function<BeamTarget(std::int64_t time_ns)>;

// The data sheet's typical curve, in volts; 0 for what reflects nothing.
[[nodiscard]] double sharp_volts(double distance_mm);

class SharpSensor {
public:
  SharpSensor(const SharpOptions &options, BeamTargetAt target, std::uint64_t seed);
  // The converter's reading in volts. Times must not decrease.
  [[nodiscard]] double read_volts(std::int64_t time_ns, bool moving);

private:
  [[nodiscard]] double measure(std::int64_t from_ns, std::int64_t to_ns);

  SharpOptions options_;
  BeamTargetAt target_;
  Random random_;
  std::int64_t period_from_ns_ = 0, period_to_ns_ = 0; // that is being measured
  double held_volts_ = 0.0;
  bool started_ = false;
};

} // namespace bregma::sim
