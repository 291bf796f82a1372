#include "drivers/sim/patient.hpp"

#include <cmath>
#include <stdexcept>

#include "drivers/sim/random.hpp"

namespace bregma::sim {

namespace {

constexpr double kClampTilt_rad = 0.15;

const casefile::Case &checked(const casefile::Case &a_case) {
  if (a_case.scalp.mesh.triangles.empty()) {
    throw std::invalid_argument("case " + a_case.id + " has no scalp: there is no head to simulate");
  }
  if (a_case.reference() == nullptr) {
    throw std::invalid_argument("case " + a_case.id + " has no tool of role reference");
  }
  return a_case;
}

// Columns: first, second made perpendicular to it, their cross product.
Matrix3d basis(const Vector3d &first, const Vector3d &second) {
  const Vector3d x = first.normalized();
  Vector3d y = second - second.dot(x) * x;
  if (y.norm() < 1e-6) {
    y = x.cross(std::abs(x.x()) < 0.7 ? Vector3d::UnitX() : Vector3d::UnitY());
  }
  y.normalize();
  Matrix3d out;
  out << x, y, x.cross(y);
  return out;
}

// z away from the camera, y down in a picture whose upper edge is the patient's superior side.
T_TrackerImage camera_pose(const PatientParameters &parameters, const Vector3d &centre) {
  const Vector3d z = -parameters.camera_direction.normalized();
  const Vector3d down = std::abs(z.z()) < 0.95 ? Vector3d(0, 0, -1) : Vector3d(0, -1, 0);
  const Vector3d y = (down - down.dot(z) * z).normalized();
  Matrix3d R_image_tracker;
  R_image_tracker << y.cross(z), y, z;
  const Quaterniond rotation(Matrix3d(R_image_tracker.transpose()));
  return {rotation, Vector3d(0, 0, parameters.camera_distance_mm) - rotation * centre};
}

} // namespace

Quaterniond point_tool(const casefile::ToolModel &tool, const Vector3d &axis_direction, const Vector3d &facing) {
  const Matrix3d R = basis(axis_direction, facing) * basis(tool.axis, tool.normal).transpose();
  return Quaterniond(R).normalized();
}

Patient::Patient(const casefile::Case &a_case, const PatientParameters &parameters, std::uint64_t seed)
    : head(checked(a_case).scalp.mesh, parameters.skin_sigma_mm, parameters.skin_correlation_mm, seed),
      T_tracker_image(camera_pose(parameters, head.centre_mm())), fiducials(a_case.fiducials),
      landmarks(a_case.landmarks) {
  Random making(seed, "tools");
  for (const auto &model : a_case.tools) {
    reference = model.role == casefile::ToolRole::kReference ? tools.size() : reference;
    tools.push_back({model, model.nominal_tip_mm + parameters.tip_offset_mm * making.direction()});
  }
  Random placing(seed, "fiducials");
  for (auto &fiducial : fiducials) {
    fiducial.position_mm += placing.normal3(parameters.fle_image_scale * a_case.limits.fle_image_mm);
  }
  Random finding(seed, "landmarks");
  for (auto &landmark : landmarks) {
    landmark.position_mm += finding.normal3(parameters.landmark_error_scale * a_case.limits.landmark_sigma_mm);
  }
  // The clamp's arm is below the head. Its markers face the camera approximately.
  const Vector3d position = head.centre_mm() + parameters.reference_offset_mm;
  const auto &model = tools[reference].model;
  const Vector3d facing = (camera_mm() - position).normalized();
  const Matrix3d across = basis(facing, Vector3d(0, 0, -1));
  Random clamping(seed, "clamp");
  const Quaterniond tilt = geometry::rotation_exp(clamping.normal3(kClampTilt_rad / 2.0));
  const Quaterniond rotation = tilt * point_tool(model, across.col(1), facing);
  Vector3d middle = Vector3d::Zero();
  for (const auto &marker : model.markers_mm) {
    middle += marker / static_cast<double>(model.markers_mm.size());
  }
  T_image_reference = {rotation, position - rotation * middle};
}

const TrueTool *Patient::tool(std::string_view name) const {
  for (const auto &tool : tools) {
    if (tool.model.name == name) {
      return &tool;
    }
  }
  return nullptr;
}

void Patient::bump_reference(const Vector3d &by_mm) {
  T_image_reference = {T_image_reference.rotation(), T_image_reference.translation() + by_mm};
}

} // namespace bregma::sim
