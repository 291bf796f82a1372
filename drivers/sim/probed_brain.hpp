// What the patient's brain truly does to the probe: it is dented until its surface breaks, then cut, and rubs along the
// shaft. Along one line, without the finite elements that the daemon predicts with: a second, simpler truth.
//
// Indentation: a sphere on an elastic half space [Hertz 1882]. Cutting and friction against the motion: [Okamura 2004].
// Where the surface has ruptured once, it does not resist again.
#pragma once

#include <optional>
#include <vector>

#include "algorithms/surface/surface_model.hpp"
#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

class ProbedBrain {
public:
  // A brain without triangles is never felt.
  ProbedBrain(const surface::TriangleMesh &brain, const TissueParameters &parameters);

  // On the probe, up its shaft: positive where the brain pushes it back. tip_mm: in Image. speed_mm_s: of the probe
  // along its shaft, positive into the tissue. To be called in the order of time.
  [[nodiscard]] double force_N(const Eigen::Vector3d &tip_mm, double speed_mm_s);

  [[nodiscard]] bool ruptured() const { return ruptured_; } // under the tip, as it is now

private:
  TissueParameters parameters_;
  std::optional<surface::SurfaceModel> surface_;
  double hertz_N_per_mm15_; // force = this times depth^1.5
  bool ruptured_ = false;
  std::vector<Eigen::Vector3d> holes_mm_; // on the surface
};

} // namespace bregma::sim
