// Insertions of a probe into a BrainModel as an operator and a tracker make them, good and bad, and what must hold of
// every answer.
//
// Deterministic by its seed. mm, N, s.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"

namespace bregma::test {

inline constexpr double kUpdate_s = 0.02; // the daemon's deformation loop
inline constexpr int kManySteps = 1000;   // of the solver in an update: enough for the clock

// Where insertions go in, and the tissue that they go into.
struct InsertionSite {
  Eigen::Vector3d entry_mm; // on the surface
  Eigen::Vector3d outward;  // unit
  double aside_mm = 10.0;   // entries are strewn so far around entry_mm
  double deepest_mm = 40.0; // of the tip under the entry
};

// What an answer may be at the most. The rupture bounds what a probe does to tissue: before it, a sphere of the probe's
// radius dents the tissue as Hertz says; after it, the tip pushes with less. The factors are for what Hertz leaves out:
// tissue in motion, held by friction along the shaft, and near an edge.
struct PhysicalBounds {
  double displacement_mm = 0.0;
  double energy_J = 0.0;
};
[[nodiscard]] PhysicalBounds physical_bounds(const tissue::BrainModelOptions &options);

// Of one insertion, or of many. Zeros are good.
struct InsertionFindings {
  int updates = 0, valid = 0, invalid = 0;
  int not_finite = 0;                // a node, a prediction or a force, whatever the status
  int inverted = 0;                  // tetrahedra of no or negative volume in an answer that is called valid
  int beyond_bounds = 0;             // valid answers beyond the physical bounds
  int contradictions = 0;            // a reason without a status that says so, or the other way round
  int not_at_rest = 0;               // insertions after which the tissue did not come back
  double largest_mm = 0.0;           // displacement of a node in a valid answer
  double largest_J = 0.0;            // elastic and kinetic energy of a valid answer
  std::vector<std::string> examples; // the first few

  void add(const InsertionFindings &other);
  [[nodiscard]] int failures() const { return not_finite + inverted + beyond_bounds + contradictions + not_at_rest; }
};

// One insertion at random: a straight way to a random depth at up to 50 mm/s, with pauses, retreats, a turning shaft,
// and now and then a tracker that loses the probe, jumps, or says what is not a number; then out again and away.
[[nodiscard]] InsertionFindings insert_at_random(tissue::BrainModel &model, const InsertionSite &site,
                                                 const PhysicalBounds &bounds, std::uint32_t seed);

} // namespace bregma::test
