// Brain shift: how the brain sinks when cerebrospinal fluid has drained from the opened skull and no longer supports
// it.
//
// In the image the brain is submerged, and its shape is in balance with weight, buoyancy and supports. Only changes
// deform it: the buoyancy lost above the fluid's new level, and weight less buoyancy in another direction where the
// head is positioned otherwise than in the scanner. The load depends on the tissue's present position; the fluid's
// level does not change. The brain slides along the skull and may separate from it (skull.hpp), slides along the falx
// (falx.hpp), and is fixed at its stem. Dynamic relaxation finds the static solution. Fluid level, sliding, the free
// surface in the craniotomy and the fixed stem are those of [Dumpuri 2007]. Tentorium, vessels and swelling are not
// modelled.
//
// Frame: that of the mesh (Image, RAS), mm; forces N. Pure functions, safe from any thread; predict_shift blocks for
// seconds. Both throw std::invalid_argument with the name and value of what is wrong.
#pragma once

#include <optional>
#include <vector>

#include "algorithms/tissue/contact/skull.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {

struct BrainShiftOptions {
  Material material; // its density affects motion only and is not used here
  SolverOptions solver;
  SkullOptions skull;
  // Direction of gravity, of any length: on the operating table, and when the image was taken. Default: supine.
  Eigen::Vector3d gravity = -Eigen::Vector3d::UnitY();
  Eigen::Vector3d gravity_imaged = -Eigen::Vector3d::UnitY();
  // Fluid level below the brain's highest point. Default: at the craniotomy's lowest edge, as far as the fluid can
  // drain.
  std::optional<double> fluid_drop_mm;
  // Tissue within this distance of the brain's most caudal point (RAS: minimum z) is fixed, since it continues into the
  // spine. 0: none; with a gap, nothing then prevents a round brain from rotating.
  double stem_mm = 15.0;
  bool falx = true; // model the falx (falx.hpp)
  double tissue_kg_m3 = 1040.0;
  double fluid_kg_m3 = 1007.0;
  double deep_mm = 30.0; // deep tissue is farther than this from the surface
  RelaxationOptions relax{.tolerance = 1e-3,
                          .max_steps = 40000,
                          .relaxed = true}; // brain shift takes minutes: the tissue has relaxed fully
};

struct ShiftedPoint {
  int node = -1; // -1: none
  Eigen::Vector3d rest_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d displacement_mm = Eigen::Vector3d::Zero();
};

struct BrainShift {
  std::vector<Eigen::Vector3d> displacement_mm; // by node
  double fluid_drop_mm = 0.0;                   // as given, or down to the craniotomy's edge
  Eigen::Vector3d load_N = Eigen::Vector3d::Zero();
  // The points of maximum displacement: on the surface in the craniotomy (without one, on all of it), and in depth.
  ShiftedPoint surface, deep;
  RelaxationResult relaxation; // the results are valid only if it has converged
  int inverted_elements = 0;
};

// Change of the load on each node, before it moves.
[[nodiscard]] std::vector<Eigen::Vector3d> shift_load_N(const TetMesh &mesh, const BrainShiftOptions &options);

[[nodiscard]] BrainShift predict_shift(const TetMesh &mesh, const BrainShiftOptions &options);

} // namespace bregma::tissue
