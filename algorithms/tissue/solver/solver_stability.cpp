// The solver's critical step: the stiffest mode of the tissue as it is deformed.
#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "algorithms/parallel/team.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"
#include "algorithms/tissue/solver/node_vector.hpp"

namespace bregma::tissue {
namespace {

constexpr float kProbeStrain = 1e-3F; // amplitude of the iterations, in edge lengths
constexpr float kLonger = 1.002F;     // maximum factor by which a check lengthens the step
constexpr int kLook = 1;              // iterations per check

// The combination of three directions with the largest Rayleigh quotient, of length 1, and that quotient. Directions
// that floats cannot separate from the others are left out.
Eigen::Vector3d stiffest_mix(const Eigen::Matrix3d &gram, const Eigen::Matrix3d &stiffness, double &quotient) {
  constexpr double kSame = 1e-6;
  Eigen::Vector3d size = gram.diagonal().cwiseSqrt();
  size = (size.array() > 0.0).select(size.cwiseInverse(), 0.0);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> own(size.asDiagonal() * gram * size.asDiagonal());
  Eigen::Matrix3d basis = size.asDiagonal() * own.eigenvectors();
  for (int k = 0; k < 3; ++k) {
    basis.col(k) *= own.eigenvalues()[k] > kSame ? 1.0 / std::sqrt(own.eigenvalues()[k]) : 0.0;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> ritz(basis.transpose() * stiffness * basis);
  quotient = ritz.eigenvalues()[2];
  return basis * ritz.eigenvectors().col(2);
}

} // namespace

// out = M^-1 K direction, by the difference of the forces at the present and at perturbed displacements.
void ExplicitSolver::apply_stiffness(const std::vector<NodeVector> &direction,
                                     const std::vector<NodeVector> &inverse_mass, float shear_Pa,
                                     std::vector<NodeVector> &out) noexcept {
  float largest = 1e-30F;
  for (const NodeVector &v : direction) {
    largest = std::max(largest, dot(v, v));
  }
  const float scale = kProbeStrain * edge_m_ / std::sqrt(largest);
  for (std::size_t i = 0; i < out.size(); ++i) {
    probe_[i] = sum(displacement_[i], scaled(direction[i], scale));
  }
  team_->run([&](int thread) { evaluate(thread, probe_, false, shear_Pa); });
  for (std::size_t i = 0; i < out.size(); ++i) {
    const NodeVector pull = scaled(difference(elastic_[i], total_force(i)), 1.0F / scale);
    const NodeVector &inverse = inverse_mass[i];
    out[i] = {inverse.x * pull.x, inverse.y * pull.y, inverse.z * pull.z};
  }
}

// The largest eigenvalue of M^-1 K of the tissue as it is deformed now, started from the previous mode, by locally
// optimal conjugate gradients [Knyazev 2001]. This takes fewer evaluations than power iteration, whose mode lags behind
// where the tissue stiffens in one place.
float ExplicitSolver::largest_eigenvalue(int iterations, const std::vector<NodeVector> &inverse_mass,
                                         std::vector<NodeVector> &mode, float shear_Pa) noexcept {
  team_->run([&](int thread) { evaluate(thread, displacement_, false, shear_Pa); });
  for (std::size_t i = 0; i < mode.size(); ++i) {
    elastic_[i] = total_force(i);
    for (int axis = 0; axis < 3; ++axis) {
      axes(mode[i])[axis] *= axes(inverse_mass[i])[axis] > 0.0F ? 1.0F : 0.0F;
    }
  }
  apply_stiffness(mode, inverse_mass, shear_Pa, mode_pull_);
  std::fill(turn_.begin(), turn_.end(), NodeVector{});
  std::fill(turn_pull_.begin(), turn_pull_.end(), NodeVector{});
  const auto product = [&](const std::vector<NodeVector> &a, const std::vector<NodeVector> &b) { // in the norm of M
    double out = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        if (const float inverse = axes(inverse_mass[i])[axis]; inverse > 0.0F) {
          out += static_cast<double>(axes(a[i])[axis]) * static_cast<double>(axes(b[i])[axis] / inverse);
        }
      }
    }
    return out;
  };
  double eigenvalue = product(mode, mode_pull_) / product(mode, mode);
  for (int iteration = 0; iteration < iterations && std::isfinite(eigenvalue); ++iteration) {
    for (std::size_t i = 0; i < mode.size(); ++i) {
      ascent_[i] = difference(mode_pull_[i], scaled(mode[i], static_cast<float>(eigenvalue)));
    }
    apply_stiffness(ascent_, inverse_mass, shear_Pa, ascent_pull_);
    const std::vector<NodeVector> *of[3] = {&mode, &ascent_, &turn_};
    const std::vector<NodeVector> *pulls[3] = {&mode_pull_, &ascent_pull_, &turn_pull_};
    Eigen::Matrix3d gram;
    Eigen::Matrix3d stiffness;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c <= r; ++c) {
        gram(r, c) = gram(c, r) = product(*of[r], *of[c]);
        stiffness(r, c) = stiffness(c, r) = 0.5 * (product(*of[r], *pulls[c]) + product(*of[c], *pulls[r]));
      }
    }
    const Eigen::Vector3d mix = stiffest_mix(gram, stiffness, eigenvalue);
    const auto part = [&](int k) { return static_cast<float>(mix[k]); };
    for (std::size_t i = 0; i < mode.size(); ++i) {
      turn_[i] = sum(scaled(ascent_[i], part(1)), scaled(turn_[i], part(2)));
      turn_pull_[i] = sum(scaled(ascent_pull_[i], part(1)), scaled(turn_pull_[i], part(2)));
      mode[i] = sum(scaled(mode[i], part(0)), turn_[i]);
      mode_pull_[i] = sum(scaled(mode_pull_[i], part(0)), turn_pull_[i]);
    }
  }
  return static_cast<float>(eigenvalue);
}

void ExplicitSolver::check_step() noexcept {
  const float stiffest = largest_eigenvalue(kLook, inverse_mass_, mode_, static_cast<float>(material_.shear_Pa()));
  const float now = static_cast<float>(options_.step_fraction) * 2.0F / std::sqrt(stiffest);
  if (std::isfinite(now) && now > 0.0F) {
    // The step shortens at once and lengthens slowly, so that it stays at its minimum during a vibration of the tissue.
    step_s_ = std::min(now, kLonger * step_s_);
  }
}

} // namespace bregma::tissue
