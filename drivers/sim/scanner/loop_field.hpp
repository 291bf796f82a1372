// Magnetic field of a coil of round turns, by the closed form for a thin circular loop with elliptic integrals
// [Jackson, Classical Electrodynamics, section 5.5], tabulated once per coil type.
//
// Units: mm, A, T. The coil's frame: origin at its centre, z along its axis. Field along the axis, and away from it.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace bregma::sim::scanner {

struct CoilShape {
  double radius_mm = 2.5;
  double length_mm = 2.5; // turns are spread evenly over it
  int turns = 20;
};

struct LoopField {
  double along_T = 0.0;
  double radial_T = 0.0;
};
// One loop of radius_mm that carries current_A, at (radial_mm >= 0, along_mm). Infinite on the wire itself.
[[nodiscard]] LoopField loop_field(double radius_mm, double current_A, double radial_mm, double along_mm);

// The coil's field per ampere, between the nodes of a table; zero beyond reach_mm. Immutable; safe to share.
class CoilField {
public:
  explicit CoilField(const CoilShape &shape, double reach_mm = 40.0);
  // T per A at a point given from the coil's centre; axis is a unit vector in the point's frame.
  [[nodiscard]] Eigen::Vector3d operator()(const Eigen::Vector3d &from_centre_mm, const Eigen::Vector3d &axis) const;

private:
  double reach_mm_;
  int nodes_;
  std::vector<Eigen::Vector2f> table_; // along, radial; radial distance runs fastest, then |along|
};

} // namespace bregma::sim::scanner
