#include "server/session/case_checksum.hpp"

#include <cstdint>
#include <cstdio>
#include <optional>
#include <string_view>
#include <type_traits>
#include <vector>

#include <Eigen/Core>
#include <boost/crc.hpp>

namespace bregma::server {
namespace {

// Every list and text is preceded by its length, so that content cannot move from one to the next unnoticed.
class Digest {
public:
  void add(std::string_view text) {
    add(static_cast<std::uint64_t>(text.size()));
    crc_.process_bytes(text.data(), text.size());
  }
  template <class Number>
  requires std::is_arithmetic_v<Number>
  void add(Number value) { crc_.process_bytes(&value, sizeof value); }
  template <class Scalar> void add(const Eigen::Matrix<Scalar, 3, 1> &vector) {
    crc_.process_bytes(vector.data(), 3 * sizeof(Scalar));
  }
  void add(const casefile::NamedPoint &point) {
    add(std::string_view(point.name));
    add(point.position_mm);
    add(std::string_view(point.placed_in));
    add(point.placing_covariance_mm2);
  }
  void add(const Eigen::Matrix3d &matrix) { crc_.process_bytes(matrix.data(), sizeof(double) * 9); }
  void add(const casefile::RegisteredImage &image) {
    add(std::string_view(image.name));
    add(std::string_view(image.sha256));
    const Eigen::Matrix4d pose = image.T_image_source.pose.matrix();
    crc_.process_bytes(pose.data(), sizeof(double) * 16);
    crc_.process_bytes(image.T_image_source.covariance.data(), sizeof(double) * 36);
  }
  void add(const casefile::Trajectory &trajectory) {
    add(std::string_view(trajectory.name));
    add(trajectory.entry_mm);
    add(trajectory.target_mm);
  }
  void add(const casefile::ToolModel &tool) {
    add(std::string_view(tool.name));
    add(static_cast<std::int32_t>(tool.role));
    add(tool.markers_mm);
    add(tool.normal);
    add(tool.axis);
    add(tool.nominal_tip_mm);
  }
  void add(const casefile::RobotToolModel &tool) { // name, tip and axis are those of the case's tools
    add(tool.sigma_mm);
    add(tool.sigma_rad);
    add(tool.radius_mm);
  }
  void add(const casefile::RangeSensorModel &sensor) {
    add(std::string_view(sensor.name));
    add(sensor.origin_mm);
    add(sensor.direction);
    crc_.process_bytes(sensor.covariance.data(), sizeof(double) * 36);
    const range::PowerLawFit curve = sensor.curve.value_or(range::PowerLawFit{});
    for (const double value :
         {curve.law.scale_mm, curve.law.exponent, curve.covariance(0, 0), curve.covariance(0, 1),
          curve.covariance(1, 1), curve.rms_mm, curve.corrected_rms_mm, static_cast<double>(sensor.window),
          sensor.delay_ms, sensor.sigma_mm, sensor.near_mm, sensor.far_mm, sensor.radius_mm, sensor.excess_mm}) {
      add(value);
    }
    for (const range::CurveCorrection &correction : curve.corrections) {
      add(correction.reading);
      add(correction.add_mm);
    }
  }
  void add(const std::optional<casefile::HandEyeModel> &hand_eye) {
    if (!hand_eye) {
      return; // sessions of cases without one keep their checksum
    }
    add(std::string_view(hand_eye->tracker));
    add(std::string_view(hand_eye->flange_body));
    const Eigen::Matrix4d X = hand_eye->T_flange_body.pose.matrix();
    const Eigen::Matrix4d Y = hand_eye->T_base_tracker.pose.matrix();
    crc_.process_bytes(X.data(), sizeof(double) * 16);
    crc_.process_bytes(Y.data(), sizeof(double) * 16);
    crc_.process_bytes(hand_eye->joint.data(), sizeof(double) * 144);
  }
  void add(const casefile::Surface &surface) {
    add(std::string_view(surface.name));
    add(surface.mesh.vertices_mm);
    add(surface.mesh.triangles);
  }
  void add(const std::optional<robot::ArmModel> &arm) {
    add(static_cast<std::uint8_t>(arm ? 1 : 0));
    if (!arm) {
      return;
    }
    for (const robot::JointAxis &axis : arm->axes_at_zero()) {
      add(axis.direction);
      add(axis.point_mm);
    }
    for (const robot::JointLimits &limits : arm->limits()) {
      add(limits.lower_rad);
      add(limits.upper_rad);
    }
    const Eigen::Matrix4d flange = arm->flange_at_zero().matrix();
    crc_.process_bytes(flange.data(), sizeof(double) * 16);
  }
  void add(const std::optional<double> &value) {
    add(static_cast<std::uint8_t>(value.has_value() ? 1 : 0));
    add(value.value_or(0.0));
  }
  template <class Item> void add(const std::vector<Item> &list) {
    add(static_cast<std::uint64_t>(list.size()));
    for (const Item &item : list) {
      add(item);
    }
  }
  [[nodiscard]] std::string text() const {
    char out[16];
    std::snprintf(out, sizeof out, "%08x", static_cast<unsigned>(crc_.checksum()));
    return out;
  }

private:
  boost::crc_32_type crc_;
};

} // namespace

std::string case_checksum(const casefile::Case &a_case) {
  Digest digest;
  digest.add(std::string_view(a_case.id));
  digest.add(std::string_view(a_case.image.filename().string()));
  digest.add(a_case.scalp);
  digest.add(a_case.brain);
  digest.add(a_case.structures);
  digest.add(a_case.fiducials);
  digest.add(a_case.landmarks);
  digest.add(a_case.brain_landmarks);
  digest.add(a_case.targets);
  digest.add(a_case.trajectories);
  digest.add(a_case.tools);
  digest.add(a_case.images);
  const casefile::Limits &limits = a_case.limits;
  for (const double limit : {limits.fle_image_mm, limits.fle_touch_mm, limits.surface_sigma_mm,
                             limits.landmark_sigma_mm, limits.max_check_mm, limits.max_target_tre_mm}) {
    digest.add(limit);
  }
  digest.add(static_cast<std::uint8_t>(a_case.craniotomy ? 1 : 0));
  if (a_case.craniotomy) {
    digest.add(std::string_view(a_case.craniotomy->trajectory));
    digest.add(a_case.craniotomy->centre_mm);
    digest.add(a_case.craniotomy->radius_mm);
  }
  digest.add(static_cast<std::uint8_t>(a_case.tissue ? 1 : 0));
  if (a_case.tissue) {
    digest.add(std::string_view(a_case.tissue->material));
    for (const auto &value :
         {a_case.tissue->young_Pa, a_case.tissue->poisson, a_case.tissue->density_kg_m3, a_case.tissue->ogden_alpha}) {
      digest.add(value);
    }
  }
  if (a_case.robot) {
    digest.add(std::string_view(a_case.robot->device));
    digest.add(a_case.robot->equipment.tools);
    digest.add(a_case.robot->equipment.sensors);
    digest.add(a_case.robot->equipment.table_z_mm);
    digest.add(a_case.robot->equipment.arm);
    digest.add(a_case.robot->equipment.hand_eye);
  }
  return digest.text();
}

} // namespace bregma::server
