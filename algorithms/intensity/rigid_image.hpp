// Rigid or affine registration of a floating image to a reference by the similarity of their intensities, in space.
//
// Both images are volumes in RAS mm; NaN marks voxels without a value. The result maps points of the floating image to
// the reference. Multi-resolution: poses from headers, centres of mass and, with Start::kSearch, from all rotations are
// compared at 8 mm, the best of them refined there and at 4 mm, and the best at the finest level. Deterministic: it
// does not depend on the number of threads or on time.
//
// The verdict is "found" only where no other pose explains the images nearly as well, restarts from perturbed poses
// come back, and the images share enough. It can take seconds, allocates, and is reentrant with a team per caller.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/intensity/similarity_measure.hpp"

namespace bregma::intensity {

using ReferenceFromFloating = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

enum class ImageVerdict { kFound, kAmbiguous, kRefused };
[[nodiscard]] std::string_view name_of(ImageVerdict verdict);

enum class Start {
  kPose,    // near the start pose, usually that of the headers
  kCentres, // and near the same rotation with centres of mass aligned
  kSearch,  // and near all rotations with centres of mass aligned
};

enum class Optimiser { kGradient, kLines }; // BFGS; Powell. Measures without a gradient always use kLines

struct RigidImageOptions {
  Measure measure = Measure::kNmi;
  MeasureOptions measure_options = {}; // max_samples and seed are those below
  Start start = Start::kSearch;
  ReferenceFromFloating T_reference_floating = {}; // start pose; identity: that of the headers
  Optimiser optimiser = Optimiser::kGradient;
  bool affine = false;
  double finest_mm = 2.0;           // spacing of the finest level
  std::size_t max_samples = 50'000; // at the finest level
  std::uint64_t seed = 1;
  int restarts = 8;
  // Called between stages with the fraction done; false stops.
  std::function<bool(double done, std::string_view stage)> progress = {};
};

// A smaller lead over the mirror image does not show which side is which (docs/images.md).
inline constexpr double kSidesKnown = 0.02;

struct ImageCandidate {
  ReferenceFromFloating T_reference_floating;
  double similarity = 0.0; // at 4 mm
};

struct RigidImageResult {
  ImageVerdict verdict = ImageVerdict::kRefused;
  std::string reason; // empty if found
  ReferenceFromFloating T_reference_floating;
  Eigen::Matrix4d affine = Eigen::Matrix4d::Identity(); // T_reference_floating, with scales and shears if wanted
  geometry::Matrix6d covariance =
      geometry::Matrix6d::Zero();         // of the rigid pose, left perturbation in the reference's frame
  double similarity = 0.0;                // at the finest level
  double mutual_information = 0.0;        // nats per sample, at the finest level
  double overlap = 0.0;                   // fraction of the smaller image
  std::vector<ImageCandidate> candidates; // distinct poses that were refined, best first
  double lead = 0.0;        // 0 to 1: best over second, relative to best over the median of the start poses
  double mirror_lead = 0.0; // the same over the mirror image of the floating image; negative: it fits better
  // Of the floating image's head along stretch_axis (unit, in the reference), by an affine map: 0.1 if it is 10 %
  // larger than the reference's. stretch_gain: how much better that map is, on the scale of lead. Not estimated with
  // `affine`.
  double stretch = 0.0;
  Eigen::Vector3d stretch_axis = Eigen::Vector3d::UnitZ();
  double stretch_gain = 0.0;
  int restarts = 0, returned = 0; // perturbed restarts until the verdict was decided, and how many came back
  int evaluations = 0;
};

[[nodiscard]] RigidImageResult register_rigid(const Volume &reference, const Volume &floating,
                                              const RigidImageOptions &options, parallel::Team &team);

// RMS distance between two poses over a sphere of radius kArm_mm about a point of the reference.
[[nodiscard]] double apart_mm(const ReferenceFromFloating &a, const ReferenceFromFloating &b,
                              const Eigen::Vector3d &centre_mm);

} // namespace bregma::intensity
