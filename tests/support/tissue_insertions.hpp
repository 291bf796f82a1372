// Random insertions of a probe into a BrainModel, with correct and faulty inputs of operator and tracker, and the
// conditions that every answer must satisfy.
//
// Deterministic for a seed. mm, N, s.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"

namespace bregma::test {

inline constexpr double kUpdate_s = 0.02; // the daemon's deformation loop
inline constexpr int kManySteps = 1000;   // solver steps per update: enough to keep up with the time

// The entry of the insertions, and the tissue.
struct InsertionSite {
  Eigen::Vector3d entry_mm; // on the surface
  Eigen::Vector3d outward;  // unit
  double aside_mm = 10.0;   // entries are distributed within this distance of entry_mm
  double deepest_mm = 40.0; // maximal depth of the tip below the entry
};

// Upper bounds of an answer. The rupture force limits the load on the tissue: before the rupture a sphere of the
// probe's radius indents the tissue according to Hertz, and after it the tip force is smaller. The factors allow for
// effects outside Hertz' theory: inertia, friction along the shaft, and edges.
struct PhysicalBounds {
  double displacement_mm = 0.0;
  double energy_J = 0.0;
};
[[nodiscard]] PhysicalBounds physical_bounds(const tissue::BrainModelOptions &options);

// Findings from one or several insertions. The expected values are zero.
struct InsertionFindings {
  int updates = 0, valid = 0, invalid = 0;
  int not_finite = 0;                // nodes, predictions or forces, for any status
  int inverted = 0;                  // tetrahedra with zero or negative volume in valid answers
  int beyond_bounds = 0;             // valid answers beyond the physical bounds
  int contradictions = 0;            // a reason without the matching status, or a status without its reason
  int not_at_rest = 0;               // insertions after which the tissue did not return to rest
  double largest_mm = 0.0;           // nodal displacement in a valid answer
  double largest_J = 0.0;            // elastic and kinetic energy of a valid answer
  std::vector<std::string> examples; // the first few

  void add(const InsertionFindings &other);
  [[nodiscard]] int failures() const { return not_finite + inverted + beyond_bounds + contradictions + not_at_rest; }
};

// One random insertion: a straight path to a random depth at up to 50 mm/s, with pauses, retreats and a rotating shaft.
// Occasionally the tracker loses the probe, jumps, or sends NaN. Finally the probe is withdrawn.
[[nodiscard]] InsertionFindings insert_at_random(tissue::BrainModel &model, const InsertionSite &site,
                                                 const PhysicalBounds &bounds, std::uint32_t seed);

} // namespace bregma::test
