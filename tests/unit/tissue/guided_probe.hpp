// A brain model and a guided probe, for tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"
#include "tests/support/tissue_insertions.hpp"

namespace bregma::tissue {

// A block that is fixed except for an opening at the top, where the probe enters.
inline constexpr double kSide_mm = 60.0;
inline constexpr double kTop_mm = 40.0;
inline const Eigen::Vector3d kEntry_mm(30.3, 29.6, kTop_mm);

inline const TetMesh &block() {
  static const TetMesh mesh = block_mesh({12, 12, 8}, {kSide_mm, kSide_mm, kTop_mm});
  return mesh;
}

inline BrainModelOptions in_an_opening() {
  BrainModelOptions options;
  options.skull = {.sliding = false, .gap_mm = 0.0, .craniotomy = {{30.0, 30.0, kTop_mm}, 28.0}};
  return options;
}

class Guided {
public:
  explicit Guided(const BrainModelOptions &options = in_an_opening())
      : model(block(), std::vector<Eigen::Vector3d>{kEntry_mm - Eigen::Vector3d(0.0, 0.0, 20.0), {500.0, 0.0, 0.0}},
              options) {}

  // Moves to a height above the entry at a speed.
  const BrainState &go_to(double to_mm, double speed_mm_s) {
    while (std::abs(height_mm - to_mm) > 1e-9) {
      const double max_mm = speed_mm_s * test::kUpdate_s;
      height_mm += std::clamp(to_mm - height_mm, -max_mm, max_mm);
      update(seen());
    }
    return model.state();
  }
  const BrainState &wait(double time_s) {
    for (double t = 0.0; t < time_s; t += test::kUpdate_s) {
      update(seen());
    }
    return model.state();
  }
  const BrainState &update(const ProbeObservation &probe, int max_steps = test::kManySteps) {
    const BrainState &state = model.update(probe, test::kUpdate_s, max_steps);
    if (phases.empty() || phases.back() != state.phase) {
      phases.push_back(state.phase);
    }
    return state;
  }
  [[nodiscard]] ProbeObservation seen() const {
    ProbeObservation probe;
    probe.seen = true;
    probe.pose.tip_mm = kEntry_mm + Eigen::Vector3d(0.0, 0.0, height_mm);
    return probe;
  }
  [[nodiscard]] double largest_mm() const {
    double out = 0.0;
    for (int i = 0; i < model.solver().nodes(); ++i) {
      out = std::max(out, model.solver().displacement_mm(i).norm());
    }
    return out;
  }

  BrainModel model;
  double height_mm = 10.0;
  std::vector<Phase> phases; // in the order of occurrence
};

} // namespace bregma::tissue
