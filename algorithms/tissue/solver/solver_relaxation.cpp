// Dynamic relaxation to the static solution.
#include <algorithm>
#include <cmath>
#include <limits>

#include "algorithms/parallel/team.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"
#include "algorithms/tissue/solver/node_vector.hpp"

namespace bregma::tissue {
namespace {

constexpr float kMaxRelaxationMove =
    0.1F; // maximum move of a node in one step, in edge lengths: there are no snap-backs here
// Steps between two checks of the slowest mode and the residual: the period of this mode, within limits. For a very
// slow mode a fifth of its period, and at most a fraction of all steps so far: in fewer steps it moves less than the
// rounding errors of the other modes.
constexpr int kRelaxInterval = 10;
constexpr int kRelaxLonger = 60;
constexpr float kRelaxFraction = 0.2F;
constexpr int kRelaxPart = 16;
// Maximum factor by which a check may raise the lowest eigenvalue. Rayleigh's quotient is an upper bound of it, and far
// above it when the slowest mode has nearly come to rest. Convergence would then be very slow.
constexpr float kRelaxRise = 2.0F;
constexpr int kRelaxFirstLook = 6;       // iterations for the stiffest mode at the first check
constexpr int kRelaxLook = 1;            // and at later checks
constexpr int kRelaxLooks = 5;           // intervals between two checks of the stiffest mode
constexpr float kStiffestMargin = 1.15F; // factor on the highest eigenvalue, which iterations approach from below
constexpr float kNegligibleMove = 1e-6F; // fraction of an edge; smaller moves count as zero
constexpr float kRounding = 3e-8F;       // relative rounding of a displacement, half the last digit of a float

int interval_between_looks(float slowest_takes, int steps_so_far) {
  const int max_interval = std::min(static_cast<int>(kRelaxFraction * slowest_takes), steps_so_far / kRelaxPart);
  return std::clamp(static_cast<int>(slowest_takes), kRelaxInterval, std::max(max_interval, kRelaxLonger));
}

} // namespace

// Heavy-ball iteration: with eigenvalues of M^-1 K between a and L, v <- keep v + dt f / m, u <- u + dt v with
// dt = 2 / (sqrt L + sqrt a), keep = ((sqrt L - sqrt a) / (sqrt L + sqrt a))^2 converges fastest [Polyak 1964];
// as dynamic relaxation: [Underwood 1983]. The masses make L about the same for all nodes (build_masses). L is updated
// while the tissue deforms; a is Rayleigh's quotient of the latest motion [Joldes 2009].
RelaxationResult ExplicitSolver::relax(const RelaxationOptions &options) noexcept {
  const auto shear = static_cast<float>(material_.shear_Pa() * (options.relaxed ? material_.relaxed_fraction() : 1.0));
  stop_motion();
  RelaxationResult out;
  float slowest = 1e-3F;
  float stiffest = 4.0F;
  double remaining_before = std::numeric_limits<double>::infinity();
  for (int look = 0; out.steps < options.max_steps; ++look) {
    if (look % kRelaxLooks == 0 || clamped_nodes() > 0) {
      const int iterations = look == 0 ? kRelaxFirstLook : kRelaxLook;
      const float seen = kStiffestMargin * largest_eigenvalue(iterations, inverse_fictitious_, relax_mode_, shear);
      stiffest = std::isfinite(seen) && seen > 0.0F ? seen : 4.0F;
    }
    const float high = std::sqrt(stiffest);
    const float low = std::sqrt(std::min(slowest, 0.25F * stiffest));
    const float ratio = (high - low) / (high + low);
    const Integration how{2.0F / (high + low), ratio * ratio, 2.0F / (high + low), kMaxRelaxationMove * edge_m_};
    const auto run = [&](int steps) {
      team_->run([&](int thread) {
        for (int i = 0; i < steps; ++i) {
          step(thread, inverse_fictitious_, how, false, shear);
        }
      });
    };
    run(1);
    std::copy(elastic_.begin(), elastic_.end(), force_before_.begin());
    std::copy(displacement_.begin(), displacement_.end(), displacement_before_.begin());
    const int interval = std::clamp(options.max_steps - out.steps, 2, interval_between_looks(high / low, out.steps));
    run(interval - 2);
    std::copy(velocity_.begin(), velocity_.end(), velocity_before_.begin());
    run(1);
    out.steps += interval;
    const double remaining = remaining_motion(how);
    out.residual = std::max({unbalanced(how), remaining, std::min(remaining_before, 1.0)});
    remaining_before = remaining;
    if (out.residual < options.tolerance && !diverges(how)) {
      out.converged = inverted_elements() == 0; // an equilibrium with inverted elements is not a solution
      break;
    }
    const float seen = lowest_eigenvalue(); // not positive: dominated by rounding errors, or not yet near a minimum
    slowest = seen > 0.0F ? std::clamp(seen, 0.5F * slowest, kRelaxRise * slowest) : kRelaxRise * slowest;
    slowest = std::clamp(slowest, 1e-8F, 1.0F);
  }
  stop_motion();
  set_prony_equilibrium(options.relaxed);
  return out;
}

// The stress history for the result of relax(): unrelaxed or fully relaxed.
void ExplicitSolver::set_prony_equilibrium(bool relaxed) noexcept {
  if (!relaxed || prony_.empty()) {
    std::fill(relaxed_.begin(), relaxed_.end(), RelaxedPack{});
    return;
  }
  for (std::size_t k = 0; k < prony_.size(); ++k) {
    prony_[k] = {0.0F, static_cast<float>(material_.prony[k].fraction)};
  }
  const auto shear = static_cast<float>(material_.shear_Pa());
  team_->run([&](int thread) { evaluate(thread, displacement_, true, shear); });
}

// Rayleigh's quotient du K du / du M du of the motion du of the latest interval. In the motion of a single step the
// rounding errors of the forces would hide the slow modes.
float ExplicitSolver::lowest_eigenvalue() const noexcept {
  double work = 0.0;
  double inertia = 0.0;
  for (std::size_t i = 0; i < displacement_.size(); ++i) {
    const NodeVector du = difference(displacement_[i], displacement_before_[i]);
    work += static_cast<double>(dot(du, difference(force_before_[i], elastic_[i])));
    inertia += static_cast<double>(0.25F * stiffness_bound_N_m_[i] * dot(du, du));
  }
  return inertia > 0.0 ? static_cast<float>(work / inertia) : 0.0F;
}

// Unbalanced force of the last step, relative to the elastic forces. Contacts and supports are included, since a
// balanced node does not move. The effect of rounding displacements to floats is subtracted.
double ExplicitSolver::unbalanced(const Integration &how) const noexcept {
  double rest = 0.0;
  double rounding = 0.0;
  double acting = 0.0;
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    const NodeVector &now = velocity_[i];
    const float mass = 0.25F * stiffness_bound_N_m_[i] / how.pull;
    const NodeVector push = difference(now, scaled(velocity_before_[i], how.keep));
    rest += static_cast<double>(mass * mass * dot(push, push));
    const float negligible = kNegligibleMove * edge_m_ * stiffness_bound_N_m_[i];
    acting += static_cast<double>(dot(elastic_[i], elastic_[i]) + negligible * negligible);
    const float noise = kRounding * stiffness_bound_N_m_[i];
    rounding += static_cast<double>(noise * noise * dot(displacement_[i], displacement_[i]));
  }
  return rest > 0.0 ? std::sqrt(std::max(rest - rounding, 0.0) / acting) : 0.0;
}

// A node was clamped, but not because it presses on a contact that moved it back.
bool ExplicitSolver::diverges(const Integration &how) const noexcept {
  const float far_squared = 0.25F * how.max_move * how.max_move;
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    const NodeVector &v = velocity_[i];
    const bool pressed = std::isfinite(dot(elastic_[i], elastic_[i])) && how.step * how.step * dot(v, v) < far_squared;
    if (v.w == kClamped && !pressed) {
      return true;
    }
  }
  return false;
}

// Estimated remaining displacement at the convergence rate of this iteration, relative to the displacement so far.
double ExplicitSolver::remaining_motion(const Integration &how) const noexcept {
  double left = 0.0;
  double gone = 0.0;
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    left += static_cast<double>(mass_kg_[i] * dot(velocity_[i], velocity_[i]));
    const float negligible = kNegligibleMove * edge_m_;
    gone += static_cast<double>(mass_kg_[i] * (dot(displacement_[i], displacement_[i]) + negligible * negligible));
  }
  return left > 0.0
             ? static_cast<double>(how.step) / (1.0 - std::sqrt(static_cast<double>(how.keep))) * std::sqrt(left / gone)
             : 0.0;
}

} // namespace bregma::tissue
