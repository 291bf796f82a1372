#include "server/stages/deformation/nodal_fields.hpp"

#include <algorithm>

#include "algorithms/tissue/material/constitutive.hpp"

namespace bregma::server {

NodalFields::NodalFields(const tissue::ExplicitSolver &solver)
    : solver_(solver), displacement_mm_(3 * static_cast<std::size_t>(solver.nodes())),
      weight_(static_cast<std::size_t>(solver.nodes())), sweep_Pa_(weight_.size()), visible_Pa_(weight_.size()) {
  for (const Eigen::Vector4i &corners : solver.mesh().tetrahedra) {
    for (const int node : corners) {
      weight_[static_cast<std::size_t>(node)] += 1.0F;
    }
  }
  for (float &weight : weight_) {
    weight = weight > 0.0F ? 1.0F / weight : 0.0F;
  }
}

void NodalFields::update_displacements() noexcept {
  for (int i = 0; i < solver_.nodes(); ++i) {
    Eigen::Vector3f::Map(&displacement_mm_[3 * static_cast<std::size_t>(i)]) = solver_.displacement_mm(i).cast<float>();
  }
}

void NodalFields::continue_stress(int elements, std::int64_t now_ns) noexcept {
  const auto &tetrahedra = solver_.mesh().tetrahedra;
  if (next_ == 0) {
    std::fill(sweep_Pa_.begin(), sweep_Pa_.end(), 0.0F);
    sweep_began_ns_ = now_ns;
  }
  const std::size_t end = std::min(next_ + static_cast<std::size_t>(std::max(elements, 0)), tetrahedra.size());
  for (; next_ < end; ++next_) {
    const auto stress_Pa = static_cast<float>(tissue::von_mises_Pa(solver_.cauchy_Pa(static_cast<int>(next_))));
    for (const int node : tetrahedra[next_]) {
      sweep_Pa_[static_cast<std::size_t>(node)] += weight_[static_cast<std::size_t>(node)] * stress_Pa;
    }
  }
  if (next_ == tetrahedra.size()) {
    std::swap(sweep_Pa_, visible_Pa_);
    visible_since_ns_ = sweep_began_ns_;
    next_ = 0;
  }
}

void NodalFields::forget_stress() noexcept {
  next_ = 0;
  visible_since_ns_ = 0;
}

} // namespace bregma::server
