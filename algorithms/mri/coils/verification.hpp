// Verification of a registration by coils that took no part in it, in the images of a later scan.
//
// What has moved the spins since the field was mapped (a susceptibility that entered the bore, a frequency that
// drifted) or the frame since it was registered, displaces these coils. Two tests decide: all coils against their
// stated errors, and their common offset against what the stated errors allow a mean. The errors of the pose and of the
// field are common to all coils and do not average out.
//
// A few tenths of a millimetre pass both, since each coil is off by its build and its detection. So what the coils show
// beyond their stated errors is returned as `unexplained`, to be added to the covariance of the pose: of the common
// offset, with the error with which the coils show it, and of the scatter along the rows and columns of the slices,
// along one of which B0 moves spins by another amount at each place. The scatter is that of the verifying coils about
// their offset and of the fitted coils about the fit. Its variance is estimated from few coils, and therefore enlarged
// as Student's t exceeds the normal.
//
// All of this is what B0 does along the read-out of this scan. It says nothing about other read-outs: verify in the
// orientation in which images are taken.
//
// Opposed read-outs (mean_of_read_outs) leave nothing of it in the pose. They also show B0 at each coil by itself, free
// of how the frame was built: b0_change().
//
// Units: mm. Frame: Base. Pure, any thread; allocates.
#pragma once

#include <cmath>
#include <span>
#include <string>

#include "algorithms/mri/coils/robot_registration.hpp"

namespace bregma::mri {

inline constexpr std::size_t kMinVerifyingCoils = 3;

struct Verification {
  double rms_mm = 0.0;                   // (16) of the coils, contains the errors of finding them; NaN without coils
  Vector3d offset_mm = Vector3d::Zero(); // mean error of the coils, weighted by their own errors
  Eigen::Matrix3d offset_covariance = Eigen::Matrix3d::Zero(); // that the stated errors give it
  // mm^2: second moment of displacements that the stated errors do not explain; zero where they explain all.
  Eigen::Matrix3d unexplained = Eigen::Matrix3d::Zero();
  std::string failure; // one sentence; empty: the coils agree with the registration
};

// coils: located with the same options (correction, limit) as the registration. expected: how many there should be.
// fitted: the coils of the registration's fit; may be empty. axes_device: unit vectors along rows, columns and normal
// of the slices.
[[nodiscard]] Verification verify_registration(const CoilFrame &frame, std::span<const LocatedCoil> coils,
                                               std::size_t expected,
                                               const geometry::UncertainPose<frame::Base, frame::Device> &T_base_device,
                                               std::span<const LocatedCoil> fitted, const Eigen::Matrix3d &axes_device,
                                               const RobotRegistrationOptions &options);

// By how much B0 displaces coils that both read-outs show otherwise than when it was mapped. Images that are taken with
// one read-out are off by as much; the pose is not.
struct B0Change {
  Eigen::Matrix3d second_moment = Eigen::Matrix3d::Zero(); // mm^2, over the coils, in Base; zero where not known
  double max_mm = std::nan("");                            // at one coil; NaN where not known
};
// coils, more: located coils; those that are not used, and those that one read-out alone shows, do not count.
[[nodiscard]] B0Change b0_change(std::span<const LocatedCoil> coils, std::span<const LocatedCoil> more,
                                 const Rigid3<frame::Base, frame::Device> &T_base_device, const MappedB0 &mapped);

// Of the slices of a stack.
[[nodiscard]] Eigen::Matrix3d unit_axes(const Stack &stack);

} // namespace bregma::mri
