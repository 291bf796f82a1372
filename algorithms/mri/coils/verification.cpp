#include "algorithms/mri/coils/verification.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <Eigen/Dense>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"

namespace bregma::mri {

namespace {

// One verification of a good registration in 500 may fail by chance: it is repeated then.
constexpr double kMinPValue = 1e-3;

// Squared errors along an axis against those that are stated, over several coils.
struct Scatter {
  double squares = 0.0, expected = 0.0, freedom = 0.0;
  // Variance beyond the stated one.
  [[nodiscard]] double excess() const {
    if (freedom < 1.0 || squares <= expected) {
      return 0.0;
    }
    constexpr double kTail = 0.05;
    return (squares - expected) / freedom * uncertainty::hotelling_upper_quantile(kTail, 1.0, freedom) /
           uncertainty::chi_square_upper_quantile(kTail, 1.0);
  }
};

std::string in_mm(double value) {
  char out[32];
  std::snprintf(out, sizeof out, "%.2f mm", value);
  return out;
}

} // namespace

Verification verify_registration(const CoilFrame &frame, std::span<const LocatedCoil> coils, std::size_t expected,
                                 const geometry::UncertainPose<frame::Base, frame::Device> &T_base_device,
                                 std::span<const LocatedCoil> fitted, const Eigen::Matrix3d &axes_device,
                                 const RobotRegistrationOptions &options) {
  using Eigen::Matrix3d;
  Verification out;
  out.rms_mm = coil_error_rms_mm(frame, coils, T_base_device.pose);
  if (coils.size() < std::min(kMinVerifyingCoils, expected) || coils.empty()) {
    out.failure = std::to_string(coils.size()) + " of " + std::to_string(expected) +
                  " coils are where the registration expects them";
    return out;
  }
  const Matrix3d R = T_base_device.pose.rotation_matrix();
  const double build = frame.build_sigma_mm * frame.build_sigma_mm;
  const auto count = static_cast<double>(coils.size());
  const auto error_of = [&](const LocatedCoil &coil) -> Vector3d {
    return T_base_device.pose * coil.position_mm - frame.coils[static_cast<std::size_t>(coil.coil)].position_mm;
  };
  // Of detection and build alone, in Base.
  const auto own_of = [&](const LocatedCoil &coil) -> Matrix3d {
    const Matrix3d field = coil.field_sigma_mm.cwiseAbs2().asDiagonal();
    return R * (coil.covariance - field) * R.transpose() + build * Matrix3d::Identity();
  };
  double statistic = 0.0;
  Matrix3d weights = Matrix3d::Zero(), field = Matrix3d::Zero();
  geometry::Matrix36d pose = geometry::Matrix36d::Zero(); // d(offset) / d(error of the pose)
  Vector3d weighted = Vector3d::Zero();
  for (const LocatedCoil &coil : coils) {
    const Vector3d at = T_base_device.pose * coil.position_mm;
    const Vector3d error = error_of(coil);
    const Matrix3d of_field = R * coil.field_sigma_mm.cwiseAbs2().asDiagonal() * R.transpose();
    const Matrix3d own = own_of(coil);
    statistic += uncertainty::mahalanobis_squared(
        own + of_field + uncertainty::tre_covariance(T_base_device.covariance, at), error);
    const Matrix3d weight = own.inverse();
    weights += weight;
    weighted += weight * error;
    pose += weight * geometry::point_jacobian(at);
    field += of_field / count;
  }
  const Matrix3d own_mean = weights.inverse();
  out.offset_mm = own_mean * weighted;
  pose = (own_mean * pose).eval();
  out.offset_covariance = own_mean + field + pose * T_base_device.covariance * pose.transpose();
  const double offset = uncertainty::mahalanobis_squared(out.offset_covariance, out.offset_mm);
  // A bound and no estimate: an offset within its stated errors exceeds this in three of four verifications, and what
  // displaces the coils is known only as well as they show it.
  const double least = uncertainty::chi_square_upper_quantile(0.75, 3.0);
  out.unexplained = std::max(0.0, 1.0 - least / offset) * (out.offset_mm * out.offset_mm.transpose() + own_mean);
  for (int axis = 0; axis < 2; ++axis) { // of the six parameters of the pose two are of each axis
    const Vector3d along = R * axes_device.col(axis);
    Scatter scatter;
    for (const LocatedCoil &coil : coils) {
      const double error = along.dot(error_of(coil) - out.offset_mm);
      scatter.squares += error * error;
      scatter.expected += along.dot(own_of(coil) * along) * (count - 1.0) / count;
    }
    scatter.freedom = count - 1.0;
    double squares = 0.0, stated = 0.0, used = 0.0;
    for (const LocatedCoil &coil : fitted) {
      if (coil.used) {
        const double error = along.dot(error_of(coil));
        squares += error * error;
        stated += along.dot(own_of(coil) * along);
        used += 1.0;
      }
    }
    if (used > 3.0) {
      scatter.squares += squares;
      scatter.expected += stated * (used - 2.0) / used;
      scatter.freedom += used - 2.0;
    }
    out.unexplained += scatter.excess() * along * along.transpose();
  }
  if (out.rms_mm > options.limit_mm) {
    out.failure = "the coils that verify are " + in_mm(out.rms_mm) + " from where the registration expects them";
  } else if (uncertainty::chi_square_survival(offset, 3.0) < kMinPValue) {
    out.failure = "the coils that verify are together " + in_mm(out.offset_mm.norm()) +
                  " off, more than the stated errors allow: the frame or the table moved, or something that disturbs "
                  "the field has entered the bore since it was mapped";
  } else if (uncertainty::chi_square_survival(statistic, 3.0 * count) < kMinPValue) {
    out.failure = "the coils that verify are " + in_mm(out.rms_mm) + " off, more than the stated errors allow";
  }
  return out;
}

B0Change b0_change(std::span<const LocatedCoil> coils, std::span<const LocatedCoil> more,
                   const Rigid3<frame::Base, frame::Device> &T_base_device, const MappedB0 &mapped) {
  B0Change out;
  if (!mapped) {
    return out;
  }
  double count = 0.0;
  for (const std::span<const LocatedCoil> list : {coils, more}) {
    for (const LocatedCoil &coil : list) {
      if (coil.used && coil.b0_mm.allFinite()) {
        const Vector3d change = T_base_device.rotation() * (coil.b0_mm - mapped(coil.position_mm));
        out.second_moment += change * change.transpose();
        out.max_mm = std::fmax(out.max_mm, change.norm()); // fmax ignores the NaN of the beginning
        count += 1.0;
      }
    }
  }
  out.second_moment /= std::max(1.0, count);
  return out;
}

Eigen::Matrix3d unit_axes(const Stack &stack) {
  Eigen::Matrix3d out = stack.axes();
  out.colwise().normalize();
  return out;
}

} // namespace bregma::mri
