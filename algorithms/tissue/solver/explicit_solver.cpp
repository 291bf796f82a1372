#include "algorithms/tissue/solver/explicit_solver.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/parallel/team.hpp"
#include "algorithms/tissue/material/constitutive.hpp"
#include "algorithms/tissue/material/units.hpp"
#include "algorithms/tissue/solver/node_vector.hpp"

namespace bregma::tissue {
namespace {

constexpr std::uint64_t kLookInterval = 50; // steps between two checks of the critical step
// Maximum move of a node in one step, in edge lengths. It is large because tissue pushed by a contact may spring back
// far before the contact stops it.
constexpr float kMaxMove = 0.5F;

// Clamps to a length, or to zero where the forces were not finite.
void clamp_length(NodeVector &v, float length) {
  const float scale = length / std::sqrt(dot(v, v));
  v = std::isfinite(scale) && scale > 0.0F ? NodeVector{v.x * scale, v.y * scale, v.z * scale} : NodeVector{};
}

// sum += by; the rounding error is kept in the remainder and added to the next summand (Kahan's summation with Knuth's
// exact error). The last steps to an equilibrium are smaller than the last digit of a displacement, and there are
// thousands of them.
void add(float &sum, float &remainder, float by) {
  by += remainder;
  const float before = sum;
  sum = before + by;
  const float taken = sum - before;
  remainder = (before - (sum - taken)) + (by - taken);
}

NodeVector node_vector(const Eigen::Vector3d &mm) {
  const Eigen::Vector3f m = (mm / kMetre).cast<float>();
  return {m.x(), m.y(), m.z()};
}

} // namespace

double ExplicitSolver::mass_kg(int node) const noexcept {
  return static_cast<double>(mass_kg_[static_cast<std::size_t>(node)]);
}

// ---- loads and supports ----

void ExplicitSolver::fix(int node, unsigned fixed_axes) noexcept {
  const auto i = static_cast<std::size_t>(node);
  fixed_[i] |= fixed_axes;
  for (int axis = 0; axis < 3; ++axis) {
    if ((fixed_[i] & (1U << static_cast<unsigned>(axis))) != 0) {
      axes(inverse_mass_[i])[axis] = 0.0F;
      axes(inverse_fictitious_[i])[axis] = 0.0F;
      axes(velocity_[i])[axis] = 0.0F;
    }
  }
}

void ExplicitSolver::release(int node) noexcept {
  const auto i = static_cast<std::size_t>(node);
  fixed_[i] = 0;
  const float real = 1.0F / mass_kg_[i];
  const float fictitious = 4.0F / stiffness_bound_N_m_[i];
  inverse_mass_[i] = {real, real, real};
  inverse_fictitious_[i] = {fictitious, fictitious, fictitious};
}

void ExplicitSolver::set_displacement_mm(int node, const Eigen::Vector3d &displacement_mm) noexcept {
  const NodeVector to = node_vector(displacement_mm);
  NodeVector &u = displacement_[static_cast<std::size_t>(node)];
  u = {to.x, to.y, to.z, u.w};
  remainder_[static_cast<std::size_t>(node)] = {};
}

void ExplicitSolver::set_force_N(int node, const Eigen::Vector3d &force_N) noexcept {
  const Eigen::Vector3f f = force_N.cast<float>();
  external_[static_cast<std::size_t>(node)] = {f.x(), f.y(), f.z()};
}

void ExplicitSolver::clear_forces() noexcept { std::fill(external_.begin(), external_.end(), NodeVector{}); }

void ExplicitSolver::set_contacts(std::vector<Contact *> contacts) { contacts_ = std::move(contacts); }

// ---- one step ----

// Computes every thread's part of the elastic forces, and the nodal pressure. Runs on all threads.
void ExplicitSolver::evaluate(int thread, std::vector<NodeVector> &nodes, bool viscous, float shear_Pa) noexcept {
  ThreadPart &own = parts_[static_cast<std::size_t>(thread)];
  ElementWork work;
  work.packs = std::span(packs_).subspan(own.packs.begin, own.packs.end - own.packs.begin);
  work.nodes = nodes.data();
  work.shear_Pa = shear_Pa;
  work.bulk_Pa = static_cast<float>(material_.bulk_Pa());
  work.element_bulk_Pa = static_cast<float>(options_.element_pressure_fraction * material_.bulk_Pa());
  work.ogden_alpha = static_cast<float>(material_.ogden_alpha);
  work.volume_change_m3 = own.volume_change.data();
  work.force_N = own.force.data();
  if (viscous && !prony_.empty()) {
    work.prony = prony_;
    work.relaxed = relaxed_.data() + own.packs.begin * prony_.size();
  }

  std::fill(own.volume_change.begin(), own.volume_change.end(), 0.0F);
  kernel_->add_volumes(work, material_.law);
  team_->barrier();

  const auto bulk = static_cast<float>((1.0 - options_.element_pressure_fraction) * material_.bulk_Pa());
  double energy = 0.0;
  for (std::size_t i = own.nodes.begin; i < own.nodes.end; ++i) {
    float change = 0.0F;
    for (const ThreadPart &other : parts_) {
      change += other.volume_change[i];
    }
    nodes[i].w = bulk * change / volume_m3_[i];
    energy += static_cast<double>(0.5F * nodes[i].w * change);
  }
  own.volume_energy = energy;
  std::fill(own.force.begin(), own.force.end(), NodeVector{});
  team_->barrier();

  own.sums = kernel_->add_forces(work, material_.law);
  team_->barrier();
}

NodeVector ExplicitSolver::total_force(std::size_t node) const noexcept {
  NodeVector sum = parts_.front().force[node];
  for (std::size_t t = 1; t < parts_.size(); ++t) {
    const NodeVector &part = parts_[t].force[node];
    sum = {sum.x + part.x, sum.y + part.y, sum.z + part.z};
  }
  return sum;
}

// Central differences for this thread's nodes: v <- keep v + pull f / m, u <- u + dt v.
void ExplicitSolver::predict(int thread, const std::vector<NodeVector> &inverse_mass, const Integration &how) noexcept {
  ThreadPart &own = parts_[static_cast<std::size_t>(thread)];
  own.clamped = 0;
  for (std::size_t i = own.nodes.begin; i < own.nodes.end; ++i) {
    const NodeVector force = total_force(i);
    const NodeVector &push = external_[i];
    const NodeVector &inverse = inverse_mass[i];
    NodeVector &u = displacement_[i];
    NodeVector &v = velocity_[i];
    elastic_[i] = force;
    v.x = how.keep * v.x + how.pull * inverse.x * (force.x + push.x);
    v.y = how.keep * v.y + how.pull * inverse.y * (force.y + push.y);
    v.z = how.keep * v.z + how.pull * inverse.z * (force.z + push.z);
    const float move_squared = how.step * how.step * dot(v, v);
    v.w = 0.0F;
    if (!(move_squared <= how.max_move * how.max_move)) {
      clamp_length(v, how.max_move / how.step);
      v.w = kClamped;
      ++own.clamped;
    }
    NodeVector &remainder = remainder_[i];
    add(u.x, remainder.x, how.step * v.x);
    add(u.y, remainder.y, how.step * v.y);
    add(u.z, remainder.z, how.step * v.z);
  }
}

// One step on all threads; the caller's barrier is the last line.
void ExplicitSolver::step(int thread, const std::vector<NodeVector> &inverse_mass, const Integration &how, bool viscous,
                          float shear_Pa) noexcept {
  evaluate(thread, displacement_, viscous, shear_Pa);
  predict(thread, inverse_mass, how);
  if (!contacts_.empty()) {
    team_->barrier();
    if (thread == 0) {
      for (Contact *contact : contacts_) {
        contact->apply({displacement_, velocity_, inverse_mass, rest_, how.step});
      }
    }
  }
  team_->barrier();
}

void ExplicitSolver::advance(int steps) noexcept {
  const auto shear = static_cast<float>(material_.shear_Pa());
  while (steps > 0) {
    if (steps_ % kLookInterval == 0 && steps_ > 0) {
      check_step();
    }
    const auto to_look = static_cast<int>(kLookInterval - steps_ % kLookInterval);
    const int now = std::min(steps, to_look);
    for (std::size_t k = 0; k < prony_.size(); ++k) {
      const double decay = std::exp(-static_cast<double>(step_s_) / material_.prony[k].time_s);
      prony_[k] = {static_cast<float>(decay), static_cast<float>(material_.prony[k].fraction * (1.0 - decay))};
    }
    const float drag = 0.5F * static_cast<float>(options_.damping_per_s) * step_s_;
    const Integration how{step_s_, (1.0F - drag) / (1.0F + drag), step_s_ / (1.0F + drag), kMaxMove * edge_m_};
    team_->run([&](int thread) {
      for (int i = 0; i < now; ++i) {
        step(thread, inverse_mass_, how, true, shear);
      }
    });
    steps_ += static_cast<std::uint64_t>(now);
    steps -= now;
  }
}

// ---- state ----

void ExplicitSolver::stop_motion() noexcept { std::fill(velocity_.begin(), velocity_.end(), NodeVector{}); }

void ExplicitSolver::save() noexcept {
  saved_displacement_ = displacement_;
  saved_relaxed_ = relaxed_;
  saved_step_s_ = step_s_;
}

void ExplicitSolver::restore() noexcept {
  displacement_ = saved_displacement_;
  std::fill(remainder_.begin(), remainder_.end(), NodeVector{});
  relaxed_ = saved_relaxed_;
  step_s_ = saved_step_s_;
  stop_motion();
}

void ExplicitSolver::reset() noexcept {
  for (std::vector<NodeVector> *field : {&displacement_, &remainder_, &velocity_, &elastic_}) {
    std::fill(field->begin(), field->end(), NodeVector{});
  }
  std::fill(relaxed_.begin(), relaxed_.end(), RelaxedPack{});
  for (ThreadPart &own : parts_) {
    own.sums = {};
    own.volume_energy = 0.0;
    own.clamped = 0;
  }
  step_s_ = step_at_rest_s_;
}

Eigen::Vector3d ExplicitSolver::displacement_mm(int node) const noexcept {
  return kMetre * to_double(displacement_[static_cast<std::size_t>(node)]);
}

Eigen::Vector3d ExplicitSolver::velocity_mm_s(int node) const noexcept {
  return kMetre * to_double(velocity_[static_cast<std::size_t>(node)]);
}

Eigen::Vector3d ExplicitSolver::elastic_force_N(int node) const noexcept {
  return to_double(elastic_[static_cast<std::size_t>(node)]);
}

Energies ExplicitSolver::energies() const noexcept {
  Energies sum;
  for (const ThreadPart &own : parts_) {
    sum.elastic_J += own.volume_energy + own.sums.elastic_J;
  }
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    sum.kinetic_J += static_cast<double>(0.5F * mass_kg_[i] * dot(velocity_[i], velocity_[i]));
  }
  return sum;
}

int ExplicitSolver::clamped_nodes() const noexcept {
  int sum = 0;
  for (const ThreadPart &own : parts_) {
    sum += own.clamped;
  }
  return sum;
}

int ExplicitSolver::inverted_elements() const noexcept {
  int sum = 0;
  for (const ThreadPart &own : parts_) {
    sum += own.sums.inverted;
  }
  return sum;
}

bool ExplicitSolver::finite() const noexcept {
  // A sum is not finite if any of its terms is not.
  float sum = 0.0F;
  for (std::size_t i = 0; i < displacement_.size(); ++i) {
    const NodeVector &u = displacement_[i];
    const NodeVector &v = velocity_[i];
    sum += 0.0F * (u.x + u.y + u.z + v.x + v.y + v.z);
  }
  return std::isfinite(sum);
}

Eigen::Matrix3d ExplicitSolver::deformation_gradient(int element) const noexcept {
  const Slot at = slot_of(static_cast<std::size_t>(element));
  const ElementPack &pack = packs_[at.pack];
  const auto u = [&](int i) { return to_double(displacement_[static_cast<std::size_t>(pack.node[i][at.lane])]); };
  Eigen::Matrix3d f = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 3; ++i) {
    for (int d = 0; d < 3; ++d) {
      f.col(d) += (u(i + 1) - u(0)) * static_cast<double>(pack.gradient[i][d][at.lane]);
    }
  }
  return f;
}

Eigen::Matrix3d ExplicitSolver::cauchy_Pa(int element) const noexcept {
  const Slot at = slot_of(static_cast<std::size_t>(element));
  const Eigen::Matrix3d f = deformation_gradient(element);
  Eigen::Matrix3d shear = shear_stress_Pa(material_, f);
  for (std::size_t k = 0; k < prony_.size(); ++k) {
    const auto s = [&](int i) {
      return static_cast<double>(relaxed_[at.pack * prony_.size() + k].stress_Pa[i][at.lane]);
    };
    Eigen::Matrix3d taken;
    taken << s(0), s(5), s(4), s(5), s(1), s(3), s(4), s(3), s(2);
    shear -= taken;
  }
  double pressure = options_.element_pressure_fraction * pressure_Pa(material_, f);
  for (const auto &corner : packs_[at.pack].node) {
    pressure += 0.25 * static_cast<double>(displacement_[static_cast<std::size_t>(corner[at.lane])].w);
  }
  return bregma::tissue::cauchy_Pa(material_, f, shear, pressure);
}

} // namespace bregma::tissue
