// Which coil of the frame made which artefact, by the frame's pattern.
//
// Triples of artefacts whose distances agree with those of three coils propose a pose; the pose that most artefacts
// agree with is taken. A pattern that fits another way as well is ambiguous and never decided by chance. Distances may
// be off by the distortion of an image that is not corrected.
//
// Units: mm. Pure, any thread; allocates.
#pragma once

#include <span>
#include <vector>

#include "algorithms/geometry/rigid3.hpp"
#include "algorithms/mri/coil_frame.hpp"
#include "algorithms/mri/frames.hpp"

namespace bregma::mri {

struct Sighting {
  Vector3d position_mm = Vector3d::Zero(); // of an artefact, in Device
  int scan = 0;                            // number of the foreground
};

struct NamingOptions {
  double tolerance_mm = 8.0;    // between an artefact and its coil after the fit
  double max_distance_mm = 6.0; // by which distances between two may differ
  double min_base_mm = 30.0;    // shortest side of a triple that proposes a pose
  double rival_mm = 1.5;        // another pattern whose RMS is at most this much larger makes the answer ambiguous
};

struct Naming {
  enum class Status { kNamed, kAmbiguous, kTooFew, kTooMany } status = Status::kTooFew;
  std::vector<int> coil;                            // of each sighting; -1: no coil that should carry current
  std::vector<int> missing;                         // coils that should have been seen in some scan
  Rigid3<frame::Base, frame::Device> T_base_device; // least squares over the named ones
  double rms_mm = 0.0;
  int named = 0;
  double rival_rms_mm = 0.0; // of the best other pattern with as many coils; 0: none
};

// on[s]: coils (indices into the frame) that carried current in scan s. At least four must be named. Far more artefacts
// than coils propose poses without end: kTooMany, within seconds.
[[nodiscard]] Naming name_coils(const CoilFrame &coils, std::span<const std::vector<int>> on,
                                std::span<const Sighting> sightings, const NamingOptions &options = {});

} // namespace bregma::mri
