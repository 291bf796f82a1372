// The true force of the patient's brain on the probe: indentation until the rupture of the surface, then cutting and
// friction along the shaft. The model is one-dimensional and independent of the daemon's finite elements.
//
// Indentation: a sphere on an elastic half space [Hertz 1882]. Cutting and friction against the motion: [Okamura 2004].
// A ruptured surface does not resist again at the same point.
#pragma once

#include <optional>
#include <vector>

#include "algorithms/surface/surface_model.hpp"
#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

class ProbedBrain {
public:
  // A brain without triangles gives no force.
  ProbedBrain(const surface::TriangleMesh &brain, const TissueParameters &parameters);

  // Force on the probe along its shaft, positive if the brain pushes it back. tip_mm: in Image. speed_mm_s: speed of
  // the probe along its shaft, positive into the tissue. To be called in the order of time.
  [[nodiscard]] double force_N(const Eigen::Vector3d &tip_mm, double speed_mm_s);

  [[nodiscard]] bool ruptured() const { return ruptured_; } // state of the surface under the current tip

private:
  TissueParameters parameters_;
  std::optional<surface::SurfaceModel> surface_;
  double hertz_N_per_mm15_; // force = this times depth^1.5
  bool ruptured_ = false;
  std::vector<Eigen::Vector3d> holes_mm_; // holes in the surface
};

} // namespace bregma::sim
