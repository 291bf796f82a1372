#include "server/session/verdicts.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <Eigen/Cholesky>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/monitoring/drift_monitor.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "idl/names.hpp"
#include "server/session/session_text.hpp"

namespace bregma::server {
namespace {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;
using Pose = geometry::Rigid3<geometry::frame::Image, geometry::frame::Reference>;

Matrix6d covariance_of(const RegistrationAccepted &registration) {
  return Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(registration.covariance.data());
}

Pose pose_of(const RegistrationAccepted &registration) {
  return wire::from_wire<geometry::frame::Image, geometry::frame::Reference>(registration.T_image_reference);
}

Matrix3d matrix_of(const Array9 &values) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(values.data());
}

bool is_finite(const RegistrationAccepted &registration) {
  const auto finite = [](double value) { return std::isfinite(value); };
  const auto &pose = registration.T_image_reference;
  return std::all_of(std::begin(pose.rotation_wxyz), std::end(pose.rotation_wxyz), finite) &&
         std::all_of(std::begin(pose.translation_mm), std::end(pose.translation_mm), finite) &&
         std::all_of(registration.covariance.begin(), registration.covariance.end(), finite);
}

Matrix3d isotropic(double sigma) { return sigma * sigma * Matrix3d::Identity(); }

// Joint p-value of the errors if the registration is as accurate as predicted. Its error x is common to all of them:
// e_i = J_i x + touch_i + landmark_i.
double joint_p_value(const casefile::Case &the_case, const RegistrationAccepted &registration,
                     const std::map<std::string, JudgedCheck> &checks) {
  const auto rows = static_cast<Eigen::Index>(3 * checks.size());
  Eigen::VectorXd errors(rows);
  Eigen::MatrixXd J(rows, 6);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(rows, rows);
  Eigen::Index row = 0;
  for (const auto &[name, check] : checks) {
    errors.segment<3>(row) = Eigen::Map<const Vector3d>(check.error_mm.data());
    J.middleRows<3>(row) = geometry::point_jacobian(the_case.landmarks[check.landmark_index].position_mm);
    covariance.block<3, 3>(row, row) =
        matrix_of(check.touch_covariance_mm2) + isotropic(the_case.limits.landmark_sigma_mm);
    row += 3;
  }
  covariance += J * covariance_of(registration) * J.transpose();
  // The error of a second image's registration is common to the landmarks that were placed in it.
  for (const casefile::RegisteredImage &image : the_case.images) {
    Eigen::MatrixXd K = J;
    row = 0;
    for (const auto &[name, check] : checks) {
      if (the_case.landmarks[check.landmark_index].placed_in != image.name) {
        K.middleRows<3>(row).setZero();
      }
      row += 3;
    }
    covariance += K * image.T_image_source.covariance * K.transpose();
  }
  const double chi_square = errors.dot(covariance.ldlt().solve(errors));
  return uncertainty::chi_square_survival(chi_square, static_cast<int>(rows));
}

} // namespace

TargetTre worst_target(const casefile::Case &the_case, const RegistrationAccepted &registration) {
  TargetTre worst;
  for (const casefile::NamedPoint &target : the_case.targets) {
    const double tre = uncertainty::rms_mm(
        uncertainty::tre_covariance(covariance_of(registration), target.position_mm) + target.placing_covariance_mm2);
    if (worst.target.empty() || !(tre <= worst.rms_mm)) {
      worst = {target.name, tre, target.placed_in, uncertainty::rms_mm(target.placing_covariance_mm2)};
    }
  }
  return worst;
}

std::string placing_text(const TargetTre &tre) {
  return tre.placed_in.empty()
             ? std::string()
             : " (" + mm(tre.placing_rms_mm) + " of it from the registration of image " + tre.placed_in + ")";
}

RegistrationAccepted accept(const RegistrationEstimate &estimate) {
  RegistrationAccepted out{estimate.revision, estimate.T_image_reference, {}, estimate.excess_mm};
  std::copy(std::begin(estimate.covariance), std::end(estimate.covariance), out.covariance.begin());
  return out;
}

std::optional<std::string> refuse_acceptance(const casefile::Case &the_case, const RegistrationEstimate &estimate) {
  if (estimate.status == bregma_wire_REGISTRATION_NONE) {
    return "there is no estimate yet: touch the fiducials first";
  }
  if (estimate.status != bregma_wire_REGISTRATION_CANDIDATE) {
    return std::string(estimate.text);
  }
  const RegistrationAccepted candidate = accept(estimate);
  if (!is_finite(candidate)) {
    return "the estimate is not finite";
  }
  const TargetTre worst = worst_target(the_case, candidate);
  if (!worst.target.empty() && !(worst.rms_mm <= the_case.limits.max_target_tre_mm)) {
    return "the predicted TRE at " + worst.target + " is " + mm(worst.rms_mm) + placing_text(worst) +
           ", more than the limit of " + mm(the_case.limits.max_target_tre_mm) +
           ": touch more fiducials or trace more surface";
  }
  return std::nullopt;
}

JudgedCheck judge_check(const casefile::Case &the_case, const RegistrationAccepted &registration,
                        std::size_t landmark_index, const wire::Name &tool, const CaptureResult &touch) {
  const casefile::NamedPoint &landmark = the_case.landmarks[landmark_index];
  const Pose T_image_reference = pose_of(registration);
  const Vector3d shown = T_image_reference * Eigen::Map<const Vector3d>(touch.position_mm.data());
  const Matrix3d R = T_image_reference.rotation_matrix();

  monitoring::CheckTouch judged;
  judged.landmark_mm = landmark.position_mm;
  judged.residual_mm = shown - landmark.position_mm;
  // The common error is in the registration too, but where the patient has moved it does not cancel.
  const Matrix3d own = matrix_of(touch.covariance_mm2) + matrix_of(touch.common_mm2);
  judged.touch_covariance = R * own * R.transpose() + isotropic(the_case.limits.fle_touch_mm);
  judged.landmark_covariance = isotropic(the_case.limits.landmark_sigma_mm) + landmark.placing_covariance_mm2;
  monitoring::DriftMonitor from_registration;
  from_registration.reset(covariance_of(registration));

  JudgedCheck out{};
  std::copy(std::begin(tool), std::end(tool), out.tool);
  (void)wire::set_name(out.landmark, landmark.name); // load_case rejects names that are too long
  out.frame = touch.frame;
  out.acquired_time_ns = touch.acquired_time_ns;
  out.position_mm = touch.position_mm;
  out.covariance_mm2 = touch.covariance_mm2;
  out.landmark_index = static_cast<std::uint32_t>(landmark_index);
  Eigen::Map<Vector3d>(out.error_mm.data()) = judged.residual_mm;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(out.touch_covariance_mm2.data()) = judged.touch_covariance;
  out.distance_mm = judged.residual_mm.norm();
  out.limit_mm = from_registration.check_limit_95_mm(judged);
  return out;
}

std::optional<std::string> refuse_verification(const casefile::Case &the_case, const RegistrationAccepted &registration,
                                               const std::map<std::string, JudgedCheck> &checks,
                                               std::size_t min_checks) {
  if (checks.size() < min_checks) {
    std::string left;
    for (const casefile::NamedPoint &landmark : the_case.landmarks) {
      if (!checks.contains(landmark.name)) {
        left += (left.empty() ? "" : ", ") + landmark.name;
      }
    }
    return std::to_string(checks.size()) + " of at least " + std::to_string(min_checks) +
           " landmarks checked since the registration was accepted or lost its verification; not checked: " +
           (left.empty() ? "none, the case has too few landmarks" : left);
  }
  const auto worst = std::max_element(checks.begin(), checks.end(), [](const auto &a, const auto &b) {
    return a.second.distance_mm < b.second.distance_mm;
  });
  const std::string worst_text =
      worst->first + " is off by " + mm(worst->second.distance_mm) + " (95 % bound " + mm(worst->second.limit_mm) + ")";
  if (!(worst->second.distance_mm <= the_case.limits.max_check_mm)) {
    return worst_text + ", more than the limit of " + mm(the_case.limits.max_check_mm) +
           ": check it again, or register anew";
  }
  const double p = joint_p_value(the_case, registration, checks);
  if (!(p >= kVerificationTail)) {
    char chance[32];
    std::snprintf(chance, sizeof chance, "%.1e", p);
    return "the checks contradict the registration (probability " + std::string(chance) + "); " + worst_text +
           ": register anew";
  }
  return std::nullopt;
}

std::optional<std::string> refuse_capture(const CaptureRequest &request, const CaptureResult &result) {
  const std::string tool = wire::text(request.tool);
  const std::string frames =
      std::to_string(result.used_frames) + " of " + std::to_string(result.window_frames) + " frames could be used";
  switch (result.status) {
  case CaptureStatus::kOk: {
    const auto finite = [](double value) { return std::isfinite(value); };
    const bool whole = std::all_of(result.position_mm.begin(), result.position_mm.end(), finite) &&
                       std::all_of(result.covariance_mm2.begin(), result.covariance_mm2.end(), finite);
    return whole ? std::nullopt : std::optional<std::string>("the position of " + tool + " is not finite");
  }
  case CaptureStatus::kNoFrames:
    return "no tracker frame came while " + tool + " was held";
  case CaptureStatus::kToolHidden:
    return tool + " was hidden: " + frames;
  case CaptureStatus::kReferenceHidden:
    return "the reference was hidden: " + frames;
  case CaptureStatus::kNotNew:
    return "the tracker repeats old poses of " + tool + " or sends them late: " + frames;
  case CaptureStatus::kImplausible:
    return "the tracker's data of " + tool + " or of the reference are implausible, see the alarms: " + frames;
  case CaptureStatus::kMoved:
    return tool + " was not held still: its tip strayed " + mm(result.motion_mm) + " from its mean, limit " +
           mm(request.max_motion_mm);
  case CaptureStatus::kNotCalibrated:
    return tool + " has no tip: calibrate it by a pivot first";
  }
  return "unknown answer of the navigation loop";
}

} // namespace bregma::server
