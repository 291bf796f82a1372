#include "drivers/sim/sensors.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

namespace {

constexpr double kSmoothing_s = 0.03; // smoothing of the speed, because of tremor
constexpr double kArm_mm = 12.0;      // lever of the sensor's bridges, from force noise to torque noise

} // namespace

wire::ForceSample ForceSensor::sample(const TrueTool *probe, const T_ImageTip &T_image_tip, std::int64_t time_ns) {
  Vector3d force = noise_.normal3(noise_N_);
  const Vector3d torque = noise_.normal3(kArm_mm * noise_N_);
  if (probe != nullptr) {
    const Vector3d axis = probe->model.axis.normalized();
    const Vector3d &tip = T_image_tip.translation();
    const double elapsed_s = static_cast<double>(time_ns - last_ns_) * 1e-9;
    if (last_ns_ != 0 && elapsed_s > 0.0) {
      const double speed = (tip - last_tip_).dot(T_image_tip.rotation() * axis) / elapsed_s;
      speed_mm_s_ += std::min(1.0, elapsed_s / kSmoothing_s) * (speed - speed_mm_s_);
    }
    last_tip_ = tip;
    last_ns_ = time_ns;
    force -= brain_.force_N(tip, speed_mm_s_) * axis;
  }
  wire::ForceSample out{};
  for (int i = 0; i < 3; ++i) {
    out.force_N[i] = force[i];
    out.torque_Nmm[i] = torque[i];
  }
  return out;
}

std::optional<wire::RangeSample> RangeSensor::sample(const T_ImageFlange &T_image_flange) {
  const double error = noise_.normal(sigma_mm_);
  const bool moved = !last_flange_ || last_flange_->translation() != T_image_flange.translation() ||
                     last_flange_->rotation().coeffs() != T_image_flange.rotation().coeffs();
  if (moved) {
    const Vector3d beam = T_image_flange.rotation() * Vector3d::UnitZ();
    const auto hit = patient_->head.first_hit(T_image_flange.translation(), beam);
    last_flange_ = T_image_flange;
    last_range_mm_.reset();
    if (hit) {
      const double slope = std::max(0.2, -patient_->head.closest(*hit).normal.dot(beam));
      last_range_mm_ = (*hit - T_image_flange.translation()).norm() - patient_->head.skin_error_mm(*hit) / slope;
    }
  }
  if (!last_range_mm_) {
    return std::nullopt;
  }
  wire::RangeSample out{};
  out.range_mm = std::max(0.0, *last_range_mm_ + error);
  out.sigma_mm = sigma_mm_;
  out.status = bregma_wire_RANGE_VALID;
  return out;
}

} // namespace bregma::sim
