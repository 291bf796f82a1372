#include "algorithms/registration/plane_step.hpp"

#include <Eigen/Cholesky>

namespace bregma::registration {

using Eigen::Matrix4f;
using Eigen::Vector3f;
using Eigen::Vector4f;
using geometry::Vector6d;

PlaneStep plane_step(const SurfaceField &field, std::span<const Vector3f> samples_mm, const PairedPose &T,
                     const Vector3d &centre_mm, double reach_mm) noexcept {
  const Eigen::Matrix3f R = T.rotation_matrix().cast<float>();
  const Vector3f t = T.translation().cast<float>();
  const Vector3f centre = centre_mm.cast<float>();
  const auto reach2 = static_cast<float>(reach_mm * reach_mm);
  // With a = (lever x n, r) and b = (n, 0) the sums of w a a', w b b' and w b a' hold all that is needed, in whole
  // vector registers.
  Matrix4f aa = Matrix4f::Zero();
  Matrix4f bb = Matrix4f::Zero();
  Matrix4f ba = Matrix4f::Zero();
  float cost = 0.0F;
  for (const Vector3f &sample : samples_mm) {
    const Vector3f p = R * sample + t;
    const SurfaceField::Plane &plane = field.plane(p);
    const float r = plane.normal.dot(p) + plane.offset;
    const float share = reach2 / (reach2 + r * r);
    const float w = share * share;
    cost += 1.0F - share;
    const Vector3f lever = (p - centre).cross(plane.normal);
    const Vector4f a(lever.x(), lever.y(), lever.z(), r);
    const Vector4f b(plane.normal.x(), plane.normal.y(), plane.normal.z(), 0.0F);
    aa.noalias() += (w * a) * a.transpose();
    bb.noalias() += (w * b) * b.transpose();
    ba.noalias() += (w * b) * a.transpose();
  }
  PlaneStep out;
  out.normal.topLeftCorner<3, 3>() = aa.topLeftCorner<3, 3>().cast<double>();
  out.normal.bottomRightCorner<3, 3>() = bb.topLeftCorner<3, 3>().cast<double>();
  out.normal.bottomLeftCorner<3, 3>() = ba.topLeftCorner<3, 3>().cast<double>();
  out.normal.topRightCorner<3, 3>() = out.normal.bottomLeftCorner<3, 3>().transpose();
  out.gradient.head<3>() = aa.col(3).head<3>().cast<double>();
  out.gradient.tail<3>() = ba.col(3).head<3>().cast<double>();
  out.cost = static_cast<double>(cost);
  return out;
}

double plane_cost(const SurfaceField &field, std::span<const Vector3f> samples_mm, const PairedPose &T,
                  double reach_mm) noexcept {
  const Eigen::Matrix3f R = T.rotation_matrix().cast<float>();
  const Vector3f t = T.translation().cast<float>();
  const auto reach2 = static_cast<float>(reach_mm * reach_mm);
  float cost = 0.0F;
  for (const Vector3f &sample : samples_mm) {
    const Vector3f p = R * sample + t;
    const SurfaceField::Plane &plane = field.plane(p);
    const float r = plane.normal.dot(p) + plane.offset;
    cost += 1.0F - reach2 / (reach2 + r * r);
  }
  return static_cast<double>(cost);
}

Vector6d solve_damped(const Matrix6d &normal, const Vector6d &gradient, double damping, double limit_mm) noexcept {
  const double weight = normal.bottomRightCorner<3, 3>().trace(); // the normals are unit vectors
  Vector6d diagonal;
  diagonal << Vector3d::Constant(damping * weight * kHeadLever_mm * kHeadLever_mm),
      Vector3d::Constant(damping * weight);
  Matrix6d damped = normal;
  damped.diagonal() += diagonal;
  const Eigen::LLT<Matrix6d> factor(damped);
  if (factor.info() != Eigen::Success) {
    return Vector6d::Zero();
  }
  Vector6d step = -factor.solve(gradient);
  const double motion = motion_at_lever_mm(step);
  if (!(motion <= limit_mm)) {
    step *= motion > 0.0 ? limit_mm / motion : 0.0;
  }
  return step.allFinite() ? step : Vector6d::Zero();
}

} // namespace bregma::registration
