#include "base/table_reader.hpp"
#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

namespace {

using base::TableReader;

// One table of numbers. A key is declared with its field, unit and range. The field's value is the default.
class Numbers {
public:
  Numbers(TableReader &root, std::string_view name) : table_(root.table(name)) {}
  ~Numbers() {
    if (table_) {
      (void)table_->finish(); // errors are kept for the document's last check
    }
  }
  Numbers(const Numbers &) = delete;
  Numbers &operator=(const Numbers &) = delete;

  Numbers &number(std::string_view key, double &value, std::string_view unit, double min, double max) {
    if (table_) {
      value = table_->number(key, value, unit, min, max);
    }
    return *this;
  }
  Numbers &integer(std::string_view key, std::int64_t &value, std::int64_t min, std::int64_t max) {
    if (table_) {
      value = table_->integer(key, value, "", min, max);
    }
    return *this;
  }
  Numbers &vector(std::string_view key, Eigen::Vector3d &value) {
    if (table_) {
      value = table_->vector3(key, value);
    }
    return *this;
  }
  void require_direction(std::string_view key, const Eigen::Vector3d &value) {
    if (table_ && value.norm() < 1e-6) {
      table_->refuse(key, "a direction cannot be zero");
    }
  }
  void require_below(std::string_view key, double value, std::string_view other, double bound) {
    if (table_ && value >= bound) {
      table_->refuse(key, "must be below " + std::string(other));
    }
  }

private:
  std::optional<TableReader> table_;
};

} // namespace

void read_parameters(TableReader &root, Scenario &scenario) {
  TrackerParameters &tracker = scenario.tracker;
  Numbers(root, "tracker")
      .number("rate_hz", tracker.rate_hz, "Hz", 20, 1000)
      .number("noise_lateral_mm", tracker.noise_lateral_mm, "mm", 0, 10)
      .number("noise_depth_mm", tracker.noise_depth_mm, "mm", 0, 10)
      .number("max_marker_angle_deg", tracker.max_marker_angle_deg, "deg", 1, 90)
      .number("near_mm", tracker.near_mm, "mm", 1, 10000)
      .number("far_mm", tracker.far_mm, "mm", 1, 10000)
      .number("half_width_deg", tracker.half_width_deg, "deg", 1, 80)
      .number("half_height_deg", tracker.half_height_deg, "deg", 1, 80)
      .number("delay_ms", tracker.delay_ms, "ms", 0, 1000)
      .number("delay_jitter_ms", tracker.delay_jitter_ms, "ms", 0, 1000)
      .number("missing_share", tracker.missing_share, "", 0, 0.9)
      .number("clock_offset_ms", tracker.clock_offset_ms, "ms", -1e9, 1e9)
      .number("clock_drift_ppm", tracker.clock_drift_ppm, "ppm", -1000, 1000)
      .number("clock_jitter_ms", tracker.clock_jitter_ms, "ms", 0, 10)
      .require_below("near_mm", tracker.near_mm, "far_mm", tracker.far_mm);

  OperatorParameters &hand = scenario.hand;
  Numbers(root, "operator")
      .number("hand_speed_mm_s", hand.hand_speed_mm_s, "mm/s", 10, 2000)
      .number("standoff_mm", hand.standoff_mm, "mm", 10, 200)
      .number("tremor_mm", hand.tremor_mm, "mm", 0, 5)
      .number("tremor_deg", hand.tremor_deg, "deg", 0, 5)
      .number("wander_mm", hand.wander_mm, "mm", 0, 10)
      .number("wander_deg", hand.wander_deg, "deg", 0, 10)
      .number("rest_share", hand.rest_share, "", 0, 1)
      .number("touch_error_scale", hand.touch_error_scale, "", 0, 20)
      .number("settle_s", hand.settle_s, "s", 0, 10)
      .number("steering_time_s", hand.steering_time_s, "s", 0.1, 10)
      .number("display_patience_s", hand.display_patience_s, "s", 0.01, 10)
      .number("reply_timeout_s", hand.reply_timeout_s, "s", 0.1, 600)
      .number("give_up_s", hand.give_up_s, "s", 0.1, 3600)
      .integer("attempts", hand.attempts, 1, 20);

  PatientParameters &patient = scenario.patient;
  Numbers(root, "patient")
      .vector("camera_direction", patient.camera_direction)
      .number("camera_distance_mm", patient.camera_distance_mm, "mm", 500, 5000)
      .vector("reference_offset_mm", patient.reference_offset_mm)
      .number("fle_image_scale", patient.fle_image_scale, "", 0, 20)
      .number("landmark_error_scale", patient.landmark_error_scale, "", 0, 20)
      .number("skin_sigma_mm", patient.skin_sigma_mm, "mm", 0, 10)
      .number("skin_correlation_mm", patient.skin_correlation_mm, "mm", 2, 200)
      .number("tip_offset_mm", patient.tip_offset_mm, "mm", 0, 20)
      .require_direction("camera_direction", patient.camera_direction);

  RobotParameters &robot = scenario.robot;
  Numbers(root, "robot")
      .number("rate_hz", robot.rate_hz, "Hz", 1, 1000)
      .number("speed_mm_s", robot.speed_mm_s, "mm/s", 1, 500)
      .number("guide_distance_mm", robot.guide_distance_mm, "mm", 10, 300)
      .number("placement_error_mm", robot.placement_error_mm, "mm", 0, 20)
      .number("encoder_noise_mrad", robot.encoder_noise_mrad, "mrad", 0, 10);

  TissueParameters &tissue = scenario.tissue;
  Numbers(root, "tissue")
      .number("young_Pa", tissue.young_Pa, "Pa", 100, 100000)
      .number("tip_radius_mm", tissue.tip_radius_mm, "mm", 0.1, 10)
      .number("rupture_N", tissue.rupture_N, "N", 0.001, 100)
      .number("cutting_N", tissue.cutting_N, "N", 0, 100)
      .number("friction_N_per_mm", tissue.friction_N_per_mm, "N/mm", 0, 10);

  SensorParameters &sensors = scenario.sensors;
  Numbers(root, "sensors")
      .number("force_rate_hz", sensors.force_rate_hz, "Hz", 1, 2000)
      .number("force_noise_N", sensors.force_noise_N, "N", 0, 10)
      .number("range_rate_hz", sensors.range_rate_hz, "Hz", 1, 1000)
      .number("range_noise_mm", sensors.range_noise_mm, "mm", 0, 100);
}

} // namespace bregma::sim
