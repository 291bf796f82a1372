// Nonrigid registration of a floating image to a reference, from a pose that is known: cubic B-splines on a lattice
// that maximise MF-MI (38) less a bending penalty [Rueckert 1999], by L-BFGS with the derivative in closed form.
//
// A point p of the reference lies in the floating image at T_floating_reference (p + u(p)). Three levels, each from the
// one before: images at 8 mm with cells twice as large, at 4 mm, and at the finest level. Deterministic, whatever the
// number of threads. A field that folds is refused. The error is not predicted: where the images are uniform, the field
// is the smoothest continuation. It takes seconds, allocates, and is reentrant with a team per caller.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "algorithms/intensity/bspline_field.hpp"
#include "algorithms/intensity/rigid_image.hpp"

namespace bregma::intensity {

struct NonrigidImageOptions {
  Measure measure = Measure::kMfMi; // or MI, NMI, GMI, AMI
  MeasureOptions measure_options = {};
  double grid_mm = 20.0;  // edge of the cells
  double bending = 100.0; // weight of the mean squared second derivatives, mm^2
  double finest_mm = 2.0;
  std::size_t max_samples = 150'000;
  std::uint64_t seed = 1;
  int max_iterations = 60;                                                // per level
  std::function<bool(double done, std::string_view stage)> progress = {}; // as in RigidImageOptions
};

struct NonrigidImageResult {
  bool found = false;
  std::string reason; // empty if found
  BSplineField field; // u, over the reference's grid
  BSplineField::Stretch jacobian;
  double largest_mm = 0.0;                          // of u, at the voxels of the finest level
  double similarity_before = 0.0, similarity = 0.0; // at the finest level
  double bending_per_mm2 = 0.0;
  int evaluations = 0;
};

// Throws as make_measure().
[[nodiscard]] NonrigidImageResult register_nonrigid(const Volume &reference, const Volume &floating,
                                                    const ReferenceFromFloating &T_reference_floating,
                                                    const NonrigidImageOptions &options, parallel::Team &team);

} // namespace bregma::intensity
