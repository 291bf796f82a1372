// The force sensor in the probe's grip and the range sensor at the robot's flange.
#pragma once

#include <cstdint>
#include <optional>

#include "drivers/sim/patient.hpp"
#include "drivers/sim/probed_brain.hpp"
#include "drivers/sim/random.hpp"
#include "drivers/sim/robot_arm.hpp"
#include "idl/topics.hpp"

namespace bregma::sim {

// Force of the brain on the probe, plus noise, in the probe's body frame.
class ForceSensor {
public:
  ForceSensor(const surface::TriangleMesh &brain, const TissueParameters &tissue, const SensorParameters &parameters,
              std::uint64_t seed)
      : brain_(brain, tissue), noise_N_(parameters.force_noise_N), noise_(seed, "force") {}
  // probe may be null, which gives noise only. Times must not decrease.
  [[nodiscard]] wire::ForceSample sample(const TrueTool *probe, const T_ImageTip &T_image_tip, std::int64_t time_ns);

private:
  ProbedBrain brain_;
  double noise_N_;
  Random noise_;
  Vector3d last_tip_ = Vector3d::Zero();
  std::int64_t last_ns_ = 0;
  double speed_mm_s_ = 0.0; // into the tissue, smoothed
};

// A beam along the flange's z to the true skin. Without an echo there is no sample.
class RangeSensor {
public:
  RangeSensor(const Patient &patient, const SensorParameters &parameters, std::uint64_t seed)
      : patient_(&patient), sigma_mm_(parameters.range_noise_mm), noise_(seed, "range") {}
  [[nodiscard]] std::optional<wire::RangeSample> sample(const T_ImageFlange &T_image_flange);

private:
  const Patient *patient_;
  double sigma_mm_;
  Random noise_;
  std::optional<T_ImageFlange> last_flange_;
  std::optional<double> last_range_mm_;
};

} // namespace bregma::sim
