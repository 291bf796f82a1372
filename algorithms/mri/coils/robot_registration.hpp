// Registration of the robot's base to the scanner by coils [Tuna 2022, IV].
//
// (6)-(8): the rigid transform that fits the coils in Device to their places in Base; here with the covariance of each
// coil (detection, building, distortion field) and with outliers left out. (10)-(12) solve for T_base_slice, which
// differs from slice to slice because T_patient_gradient does. This solves for T_base_device, which does not; the
// transform of one slice follows from it (T_base_slice).
//
// An FRE (15) is a consistency. The accuracy is the predicted TRE, from the covariance. `kFound` states both a
// consistent fit and an accuracy within the limit; anything else states why not.
//
// Units: mm. Pure, any thread; allocates.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/mri/coil_frame.hpp"
#include "algorithms/mri/coils/artefacts.hpp"
#include "algorithms/mri/coils/coil_names.hpp"
#include "algorithms/mri/frames.hpp"

namespace bregma::mri {

// A pair of stacks and what carried current in the foreground. T_image_index of both leads to Device.
struct CoilScan {
  std::string name; // for messages: "top"
  const Stack *background = nullptr;
  const Stack *foreground = nullptr;
  const Stack *opposite = nullptr; // the foreground with the current reversed, or none: positions are averaged
  std::vector<int> on;             // coils of the frame
  // Coils that must not take part in the fit, because they verify it: they are named with the others, and are targets
  // of (16).
  std::vector<int> verify = {};
  // Both with the read-out reversed, or none: positions are averaged (mean_of_read_outs). The correction must then be
  // by the gradients' part of the field alone.
  const Stack *reversed_background = nullptr;
  const Stack *reversed_foreground = nullptr;
};

// Where a point that the scanner shows really is, with one sigma of each coordinate. Nothing where the field is
// unknown.
struct CorrectedPoint {
  Vector3d position_mm = Vector3d::Zero();
  Vector3d sigma_mm = Vector3d::Zero();
};
using PointCorrection = std::function<std::optional<CorrectedPoint>(const Vector3d &device_mm)>;

// By which B0 displaced a point of Device in scans with the read-out forward when the field was mapped, mm.
using MappedB0 = std::function<Vector3d(const Vector3d &device_mm)>;

struct RobotRegistrationOptions {
  ArtefactOptions artefacts;
  NamingOptions naming;
  PointCorrection correction;            // empty: none
  MappedB0 mapped_b0;                    // for the verification by opposed read-outs; empty: not known
  double uncorrected_sigma_mm = 1.0;     // of each coordinate, where there is no correction
  double limit_mm = 3.0;                 // of the predicted 95 % error at the target
  Vector3d target_mm = Vector3d::Zero(); // in Base
  double min_p_value = 1e-4;             // of the fit
  // Rotation of the base that the room allows, and by how much the real one may differ from it.
  std::optional<Eigen::Quaterniond> expected_rotation; // R_base_device
  double max_rotation_deg = 60.0;
};

struct LocatedCoil {
  int coil = -1; // of the frame; -1: without a name, as the pattern fits not at all or in two ways
  int scan = 0;
  Vector3d shown_mm = Vector3d::Zero();                 // in Device, as found
  Vector3d position_mm = Vector3d::Zero();              // in Device, corrected
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); // of position_mm, that of the field included
  Vector3d b0_mm = Vector3d::Constant(std::nan(""));    // by which B0 displaces it (CoilArtefact)
  Vector3d field_sigma_mm = Vector3d::Zero();           // one sigma of the field's correction, in Device
  double residual_mm = 0.0;                             // in Base, after the fit
  bool used = false;                                    // false: an outlier
};

enum class RegistrationVerdict { kFound, kInaccurate, kInconsistent, kAmbiguous, kRefused };
[[nodiscard]] const char *name(RegistrationVerdict verdict) noexcept;

struct RobotRegistration {
  RegistrationVerdict verdict = RegistrationVerdict::kRefused;
  std::string reason;             // one sentence, empty for kFound
  std::vector<std::string> notes; // missing, doubled and moved coils, and what to do
  geometry::UncertainPose<frame::Base, frame::Device> T_base_device;
  std::vector<LocatedCoil> coils;    // of the fit
  std::vector<LocatedCoil> verified; // those that verify it, and took no part
  double fre_mm = 0.0, fre_expected_mm = 0.0, p_value = 0.0;
  double tre_95_mm = 0.0; // predicted at the target
  // (16) of the coils that verify; contains the error of finding them. NaN without. Three or more are tested
  // (verification.hpp): what they find and the stated errors do not explain enters the covariance.
  double verified_mm = 0.0;
  // Largest displacement of a coil by B0 that has changed since it was mapped; NaN unless opposed read-outs and
  // mapped_b0 show it. It does not displace the registration, but images of one read-out.
  double b0_change_mm = std::nan("");
  double opme_mm = 0.0; // (17) of the coils used, along the normal of their slices
};

// Finds, names and registers. Artefacts of the scans come first as errors: verdict kRefused with the scan's name.
[[nodiscard]] RobotRegistration register_robot(const CoilFrame &frame, std::span<const CoilScan> scans,
                                               const RobotRegistrationOptions &options = {});

// The same from artefacts that are known already, a list per scan: for slices that come one by one (ArtefactFinder). Of
// the scans, names, backgrounds and coils are used.
[[nodiscard]] RobotRegistration register_artefacts(const CoilFrame &frame, std::span<const CoilScan> scans,
                                                   std::span<const std::vector<CoilArtefact>> artefacts,
                                                   const RobotRegistrationOptions &options = {});

// Coils of other scans, found near where the registration expects them: targets for (16).
[[nodiscard]] tl::expected<std::vector<LocatedCoil>, std::string>
locate_targets(const CoilFrame &frame, const CoilScan &scan, const RobotRegistration &registration,
               const RobotRegistrationOptions &options = {});

// (15), (16): root mean square over coils. (17): along the unit normal of the plane, given in Device. NaN without
// coils.
[[nodiscard]] double coil_error_rms_mm(const CoilFrame &frame, std::span<const LocatedCoil> coils,
                                       const Rigid3<frame::Base, frame::Device> &T_base_device);
[[nodiscard]] double coil_out_of_plane_mm(const CoilFrame &frame, std::span<const LocatedCoil> coils,
                                          const Rigid3<frame::Base, frame::Device> &T_base_device,
                                          const Vector3d &normal_device);

// Semi-axis of the region that contains the error of the pose at a point of Base with 95 %.
[[nodiscard]] double predicted_95_mm(const geometry::UncertainPose<frame::Base, frame::Device> &T_base_device,
                                     const Vector3d &target_mm);

// (10a): the transform of one slice.
[[nodiscard]] Rigid3<frame::Base, frame::Slice> T_base_slice(const Rigid3<frame::Base, frame::Device> &T_base_device,
                                                             const SlicePlane &plane);

} // namespace bregma::mri
