// Displacement and stress of every node of a tissue model, for the topic DeformationField.
//
// The stress of all elements takes milliseconds, which the solver needs. It is therefore computed in sweeps: each
// period takes the next elements, and a sweep becomes visible when it has taken them all. The stress of a node is the
// mean of the von Mises stresses of its elements.
//
// Threads: the constructor on a worker, the rest on one thread. Only the constructor allocates or throws.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::server {

class NodalFields {
public:
  // solver: outlives this object. Throws std::bad_alloc.
  explicit NodalFields(const tissue::ExplicitSolver &solver);

  // Copies the present displacements.
  void update_displacements() noexcept;
  // Takes the next elements into the sweep.
  void continue_stress(int elements, std::int64_t now_ns) noexcept;
  // Abandons the sweep and what is visible of the last one.
  void forget_stress() noexcept;

  // x, y, z per node, mm, as of the last update. Not const: Cyclone's sequences are not.
  [[nodiscard]] std::vector<float> &displacement_mm() noexcept { return displacement_mm_; }
  // Pa per node, of the last complete sweep; undefined before the first.
  [[nodiscard]] std::vector<float> &von_mises_Pa() noexcept { return visible_Pa_; }
  // Time at which that sweep began; 0 before the first.
  [[nodiscard]] std::int64_t stress_time_ns() const noexcept { return visible_since_ns_; }

private:
  const tissue::ExplicitSolver &solver_;
  std::vector<float> displacement_mm_;
  std::vector<float> weight_; // 1 / number of elements, per node
  std::vector<float> sweep_Pa_;
  std::vector<float> visible_Pa_;
  std::size_t next_ = 0; // element
  std::int64_t sweep_began_ns_ = 0;
  std::int64_t visible_since_ns_ = 0;
};

} // namespace bregma::server
