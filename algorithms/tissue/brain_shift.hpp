// Brain shift: how the brain sinks when cerebrospinal fluid has run out of the opened skull and carries it no longer.
//
// In the image the brain is submerged, and the shape that is seen there is the one in which its weight, its buoyancy
// and what holds it are in balance. What deforms it is what changes after that: above the fluid's new level the
// buoyancy is lost, and where the head lies otherwise than it was imaged, weight less buoyancy pulls another way. The
// load is that of where the tissue is, the fluid's level stands still. The brain slides along the skull and may leave
// it (skull.hpp), slides along the falx (falx.hpp), and is held at its stem; the static answer is by dynamic
// relaxation. Fluid level, sliding, the free surface in the craniotomy and the fixed stem as in Dumpuri et al., Med
// Image Anal 11 (2007), PMC3819812. Tentorium, vessels and swelling are not modelled.
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
  Material material; // its density is for motion and does not count here
  SolverOptions solver;
  SkullOptions skull;
  // Directions in which things fall, of any length: on the operating table, and when the image was taken. Supine.
  Eigen::Vector3d gravity = -Eigen::Vector3d::UnitY();
  Eigen::Vector3d gravity_imaged = -Eigen::Vector3d::UnitY();
  // How far the fluid's level has fallen below the brain's highest point. Where it is not given: as far as the fluid
  // can run out, to the craniotomy's lowest edge.
  std::optional<double> fluid_drop_mm;
  // Tissue within this of the brain's most caudal point (RAS: lowest z) is held: it goes on into the spine. 0: none;
  // with a gap, nothing then keeps a round brain from turning.
  double stem_mm = 15.0;
  bool falx = true; // it is there (falx.hpp)
  double tissue_kg_m3 = 1040.0;
  double fluid_kg_m3 = 1007.0;
  double deep_mm = 30.0; // from the surface on, tissue is called deep
  RelaxationOptions relax{
      .tolerance = 1e-3, .max_steps = 40000, .relaxed = true}; // shift takes minutes: all has relaxed
};

struct ShiftedPoint {
  int node = -1; // -1: there is none
  Eigen::Vector3d rest_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d displacement_mm = Eigen::Vector3d::Zero();
};

struct BrainShift {
  std::vector<Eigen::Vector3d> displacement_mm; // by node
  double fluid_drop_mm = 0.0;                   // as given, or to the craniotomy's edge
  Eigen::Vector3d load_N = Eigen::Vector3d::Zero();
  // What moves farthest: of the surface in the craniotomy (without one: of all of it), and of what is deep.
  ShiftedPoint surface, deep;
  RelaxationResult relaxation; // where it has not converged, none of this is an answer
  int inverted_elements = 0;
};

// What is new in what acts on each node, before it moves.
[[nodiscard]] std::vector<Eigen::Vector3d> shift_load_N(const TetMesh &mesh, const BrainShiftOptions &options);

[[nodiscard]] BrainShift predict_shift(const TetMesh &mesh, const BrainShiftOptions &options);

} // namespace bregma::tissue
