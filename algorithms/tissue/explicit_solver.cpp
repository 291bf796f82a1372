#include "algorithms/tissue/explicit_solver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "algorithms/tissue/constitutive.hpp"
#include "algorithms/tissue/team.hpp"
#include "algorithms/tissue/units.hpp"

namespace bregma::tissue {
namespace {

constexpr int kFirstLook = 20;              // iterations for the stiffest mode of the tissue at rest
constexpr std::uint64_t kLookInterval = 50; // steps between two looks at the critical step
constexpr float kProbeStrain = 1e-3F;       // amplitude of the iterations, in edge lengths
// Of a node in one step, in edge lengths: what is pushed by a contact may want to spring back far, for the contact to
// stop it; in relax() nothing springs.
constexpr float kLongestWay = 0.5F;
constexpr float kLongestRelaxWay = 0.1F;
constexpr float kLonger = 1.002F;        // by what a look may lengthen the step
constexpr int kLook = 1;                 // iterations of a later look
constexpr int kRelaxInterval = 10;       // steps of relax() between two looks at the slowest mode and the residual;
constexpr int kRelaxLongest = 60;        // more where it is slow, up to this
constexpr int kRelaxFirstLook = 6;       // power iterations
constexpr int kRelaxLooks = 5;           // intervals of relax() between two looks at the stiffest mode
constexpr float kStiffestMargin = 1.15F; // of the stiffest eigenvalue: iterations come from below
constexpr float kLimited = 1.0F;         // fourth component of a velocity that was cut
constexpr float kNothing = 1e-6F;        // of an edge: what moves less has not moved
constexpr float kRounding = 3e-8F;       // of a displacement, half the last digit of a float

float *axes(NodeVector &v) { return &v.x; }
const float *axes(const NodeVector &v) { return &v.x; }

float dot(const NodeVector &a, const NodeVector &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

NodeVector sum(const NodeVector &a, const NodeVector &b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }

NodeVector difference(const NodeVector &a, const NodeVector &b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }

NodeVector scaled(const NodeVector &v, float by) { return {by * v.x, by * v.y, by * v.z}; }

// To a length, or to nothing where the forces were not finite.
void limit(NodeVector &v, float length) {
  const float scale = length / std::sqrt(dot(v, v));
  v = std::isfinite(scale) && scale > 0.0F ? NodeVector{v.x * scale, v.y * scale, v.z * scale} : NodeVector{};
}

// sum += by; what that rounds off is kept in the remainder and comes with the next summand (Kahan; Knuth's exact
// error). The last steps to an equilibrium are smaller than the last digit of a displacement, and there are thousands
// of them.
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

// Rows: gradients (1/mm) of the shape functions of nodes 1 to 3 of a tetrahedron at rest.
Eigen::Matrix3d gradients_per_mm(const TetMesh &mesh, const Eigen::Vector4i &t, double &volume_mm3) {
  const auto node = [&](int i) -> const Eigen::Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
  Eigen::Matrix3d edges; // columns: nodes 1 to 3 from node 0
  for (int i = 0; i < 3; ++i) {
    edges.col(i) = node(i + 1) - node(0);
  }
  volume_mm3 = edges.determinant() / 6.0;
  return edges.inverse();
}

// The mix of three directions for which Rayleigh's quotient is largest, of length 1, and that quotient. Directions that
// floats cannot tell from the others are left out.
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

struct ExplicitSolver::Share {
  Range packs, nodes;
  std::vector<float> volume_change;
  std::vector<NodeVector> force;
  ElementSums sums;
  double volume_energy = 0.0;
  int limited = 0;
};

ExplicitSolver::ExplicitSolver(const TetMesh &mesh, const Material &material, const SolverOptions &options)
    : mesh_(mesh), material_(material), options_(options),
      kernel_(options.kernel != nullptr ? options.kernel : &element_kernels().front()) {
  check(mesh);
  check(material);
  if (material.prony.size() > kMaxPronyTerms) {
    throw std::invalid_argument("material '" + material.name + "': " + std::to_string(material.prony.size()) +
                                " Prony terms, at most " + std::to_string(kMaxPronyTerms));
  }
  if (options.threads < 1 || !(options.step_fraction > 0.0 && options.step_fraction <= 1.0) ||
      !(options.minimum_step_s >= 0.0) || !(options.damping_per_s >= 0.0) ||
      !(options.own_pressure >= 0.0 && options.own_pressure <= 1.0)) {
    throw std::invalid_argument("solver options: threads at least 1, step_fraction in (0, 1], minimum_step_s and "
                                "damping_per_s not negative, own_pressure in [0, 1]");
  }
  const std::size_t nodes = mesh_.nodes_mm.size();
  team_ = std::make_unique<Team>(options.threads);
  rest_.reserve(nodes);
  for (const Eigen::Vector3d &node : mesh_.nodes_mm) {
    rest_.emplace_back((node / kMetre).cast<float>());
  }
  fixed_.assign(nodes, 0);
  for (std::vector<NodeVector> *field :
       {&displacement_, &remainder_, &velocity_, &external_, &elastic_, &mode_, &mode_pull_, &ascent_, &ascent_pull_,
        &turn_, &turn_pull_, &probe_, &force_before_, &velocity_before_, &displacement_before_}) {
    field->assign(nodes, {});
  }
  build_packs();
  edge_m_ = std::cbrt(static_cast<float>(volume_mm3(mesh_) / static_cast<double>(nodes)) / 1e9F);

  shares_.resize(static_cast<std::size_t>(team_->size()));
  for (std::size_t t = 0; t < shares_.size(); ++t) {
    const auto part = [&](std::size_t count) {
      return Range{count * t / shares_.size(), count * (t + 1) / shares_.size()};
    };
    shares_[t].packs = part(packs_.size());
    shares_[t].nodes = part(nodes);
    shares_[t].volume_change.assign(nodes, 0.0F);
    shares_[t].force.assign(nodes, {});
  }

  build_masses(options.minimum_step_s);
  // A pattern in which neighbours move against each other, as they do in the fastest mode.
  for (std::size_t i = 0; i < nodes; ++i) {
    const auto sign = [i](std::size_t bit) { return ((i * 2654435761U) >> bit & 1U) != 0 ? 1.0F : -1.0F; };
    mode_[i] = {sign(7), sign(13), sign(19)};
  }
  const float stiffest = largest_eigenvalue(kFirstLook, inverse_mass_, mode_, static_cast<float>(material_.shear_Pa()));
  step_s_ = static_cast<float>(options.step_fraction) * 2.0F / std::sqrt(stiffest);
  step_at_rest_s_ = step_s_;
  relax_mode_ = mode_;
  prony_.resize(material_.prony.size());
  relaxed_.assign(packs_.size() * prony_.size(), {});
  reset(); // what the iteration left in energies and pressures
  save();
}

ExplicitSolver::~ExplicitSolver() = default;

void ExplicitSolver::build_packs() {
  const std::size_t elements = mesh_.tetrahedra.size();
  packs_.assign((elements + kPack - 1) / kPack, {});
  volume_m3_.assign(rest_.size(), 0.0F);
  stiffness_bound_N_m_.assign(rest_.size(), 0.0F);
  for (std::size_t e = 0; e < packs_.size() * kPack; ++e) {
    ElementPack &pack = packs_[e / kPack];
    const std::size_t lane = e % kPack;
    const Eigen::Vector4i &t = mesh_.tetrahedra[std::min(e, elements - 1)];
    for (int i = 0; i < 4; ++i) {
      pack.node[i][lane] = t[i];
    }
    if (e >= elements) {
      continue; // fills the last pack up
    }
    double volume_mm3 = 0.0;
    const Eigen::Matrix3d gradients = gradients_per_mm(mesh_, t, volume_mm3) * kMetre;
    const double volume = volume_mm3 / (kMetre * kMetre * kMetre);
    pack.volume_m3[lane] = static_cast<float>(volume);
    Eigen::Vector4d sizes;
    sizes[0] = gradients.colwise().sum().norm();
    for (int i = 0; i < 3; ++i) {
      sizes[i + 1] = gradients.row(i).norm();
      for (int d = 0; d < 3; ++d) {
        pack.gradient[i][d][lane] = static_cast<float>(gradients(i, d));
      }
    }
    for (int i = 0; i < 4; ++i) {
      const auto node = static_cast<std::size_t>(t[i]);
      volume_m3_[node] += static_cast<float>(0.25 * volume);
      stiffness_bound_N_m_[node] += static_cast<float>(volume * material_.wave_modulus_Pa() * sizes[i] * sizes.sum());
    }
  }
}

// Gershgorin: the rows of the stiffness matrix are no larger than stiffness_bound_, so a node of mass
// bound (dt / 2)^2 allows the step dt. That makes the masses of relax(), where all nodes allow the step 1, and those of
// mass scaling.
void ExplicitSolver::build_masses(double minimum_step_s) {
  const auto density = static_cast<float>(material_.density_kg_m3);
  mass_kg_.resize(rest_.size());
  inverse_mass_.resize(rest_.size());
  inverse_fictitious_.resize(rest_.size());
  double before = 0.0;
  double after = 0.0;
  const double half_step = 0.5 * minimum_step_s / options_.step_fraction;
  for (std::size_t i = 0; i < mass_kg_.size(); ++i) {
    const float mass = density * volume_m3_[i];
    mass_kg_[i] = std::max(mass, static_cast<float>(stiffness_bound_N_m_[i] * half_step * half_step));
    before += static_cast<double>(mass);
    after += static_cast<double>(mass_kg_[i]);
    release(static_cast<int>(i));
  }
  added_mass_share_ = after / before - 1.0;
}

double ExplicitSolver::mass_kg(int node) const noexcept {
  return static_cast<double>(mass_kg_[static_cast<std::size_t>(node)]);
}

// ---- what acts ----

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

// Leaves every thread's part of the elastic forces in its share, and the pressure in the nodes. On all threads.
void ExplicitSolver::evaluate(int thread, std::vector<NodeVector> &nodes, bool viscous, float shear_Pa) noexcept {
  Share &share = shares_[static_cast<std::size_t>(thread)];
  ElementWork work;
  work.packs = std::span(packs_).subspan(share.packs.begin, share.packs.end - share.packs.begin);
  work.nodes = nodes.data();
  work.shear_Pa = shear_Pa;
  work.bulk_Pa = static_cast<float>(material_.bulk_Pa());
  work.own_bulk_Pa = static_cast<float>(options_.own_pressure * material_.bulk_Pa());
  work.ogden_alpha = static_cast<float>(material_.ogden_alpha);
  work.volume_change_m3 = share.volume_change.data();
  work.force_N = share.force.data();
  if (viscous && !prony_.empty()) {
    work.prony = prony_;
    work.relaxed = relaxed_.data() + share.packs.begin * prony_.size();
  }

  std::fill(share.volume_change.begin(), share.volume_change.end(), 0.0F);
  kernel_->add_volumes(work, material_.law);
  team_->barrier();

  const auto bulk = static_cast<float>((1.0 - options_.own_pressure) * material_.bulk_Pa());
  double energy = 0.0;
  for (std::size_t i = share.nodes.begin; i < share.nodes.end; ++i) {
    float change = 0.0F;
    for (const Share &other : shares_) {
      change += other.volume_change[i];
    }
    nodes[i].w = bulk * change / volume_m3_[i];
    energy += static_cast<double>(0.5F * nodes[i].w * change);
  }
  share.volume_energy = energy;
  std::fill(share.force.begin(), share.force.end(), NodeVector{});
  team_->barrier();

  share.sums = kernel_->add_forces(work, material_.law);
  team_->barrier();
}

NodeVector ExplicitSolver::total_force(std::size_t node) const noexcept {
  NodeVector sum = shares_.front().force[node];
  for (std::size_t t = 1; t < shares_.size(); ++t) {
    const NodeVector &part = shares_[t].force[node];
    sum = {sum.x + part.x, sum.y + part.y, sum.z + part.z};
  }
  return sum;
}

// Central differences for the share's nodes: v <- keep v + pull f / m, u <- u + dt v.
void ExplicitSolver::predict(int thread, const std::vector<NodeVector> &inverse_mass, const Integration &how) noexcept {
  Share &share = shares_[static_cast<std::size_t>(thread)];
  share.limited = 0;
  for (std::size_t i = share.nodes.begin; i < share.nodes.end; ++i) {
    const NodeVector force = total_force(i);
    const NodeVector &push = external_[i];
    const NodeVector &inverse = inverse_mass[i];
    NodeVector &u = displacement_[i];
    NodeVector &v = velocity_[i];
    elastic_[i] = force;
    v.x = how.keep * v.x + how.pull * inverse.x * (force.x + push.x);
    v.y = how.keep * v.y + how.pull * inverse.y * (force.y + push.y);
    v.z = how.keep * v.z + how.pull * inverse.z * (force.z + push.z);
    const float way_squared = how.step * how.step * dot(v, v);
    v.w = 0.0F;
    if (!(way_squared <= how.longest_way * how.longest_way)) {
      limit(v, how.longest_way / how.step);
      v.w = kLimited;
      ++share.limited;
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
      look_at_step();
    }
    const auto to_look = static_cast<int>(kLookInterval - steps_ % kLookInterval);
    const int now = std::min(steps, to_look);
    for (std::size_t k = 0; k < prony_.size(); ++k) {
      const double decay = std::exp(-static_cast<double>(step_s_) / material_.prony[k].time_s);
      prony_[k] = {static_cast<float>(decay), static_cast<float>(material_.prony[k].share * (1.0 - decay))};
    }
    const float drag = 0.5F * static_cast<float>(options_.damping_per_s) * step_s_;
    const Integration how{step_s_, (1.0F - drag) / (1.0F + drag), step_s_ / (1.0F + drag), kLongestWay * edge_m_};
    team_->run([&](int thread) {
      for (int i = 0; i < now; ++i) {
        step(thread, inverse_mass_, how, true, shear);
      }
    });
    steps_ += static_cast<std::uint64_t>(now);
    steps -= now;
  }
}

// ---- the critical step ----

// out = M^-1 K direction, by the difference of the forces at the present displacements and beside them.
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

// The largest eigenvalue of M^-1 K of the tissue as it is deformed now, from the mode that was found last time: the
// locally optimal conjugate gradients of Knyazev (SIAM J Sci Comput 23 (2001) 517), upwards. In fewer evaluations than
// power iteration, whose mode lags behind where the tissue stiffens in one place.
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

void ExplicitSolver::look_at_step() noexcept {
  const float stiffest = largest_eigenvalue(kLook, inverse_mass_, mode_, static_cast<float>(material_.shear_Pa()));
  const float now = static_cast<float>(options_.step_fraction) * 2.0F / std::sqrt(stiffest);
  if (std::isfinite(now) && now > 0.0F) {
    // Shorter at once, longer by and by: over a swing of the tissue it stays at its shortest.
    step_s_ = std::min(now, kLonger * step_s_);
  }
}

// ---- dynamic relaxation ----

// Heavy-ball iteration: with eigenvalues of M^-1 K between a and L, v <- keep v + dt f / m, u <- u + dt v with
// dt = 2 / (sqrt L + sqrt a), keep = ((sqrt L - sqrt a) / (sqrt L + sqrt a))^2 converges fastest (Polyak 1964; as
// dynamic relaxation Underwood 1983). The masses make L about the same for all nodes (build_masses); L is looked at
// while the tissue deforms, a is Rayleigh's quotient of the latest motion (Joldes, Wittek & Miller, Comput Methods Appl
// Mech Eng 198 (2009) 2645).
Relaxation ExplicitSolver::relax(const RelaxOptions &options) noexcept {
  const auto shear = static_cast<float>(material_.shear_Pa() * (options.relaxed ? material_.relaxed_share() : 1.0));
  stop_motion();
  Relaxation out;
  float slowest = 1e-3F;
  float stiffest = 4.0F;
  double way_before = std::numeric_limits<double>::infinity();
  for (int look = 0; out.steps < options.max_steps; ++look) {
    if (look % kRelaxLooks == 0 || limited_nodes() > 0) {
      const int iterations = look == 0 ? kRelaxFirstLook : kLook;
      const float seen = kStiffestMargin * largest_eigenvalue(iterations, inverse_fictitious_, relax_mode_, shear);
      stiffest = std::isfinite(seen) && seen > 0.0F ? seen : 4.0F;
    }
    const float high = std::sqrt(stiffest);
    const float low = std::sqrt(std::min(slowest, 0.25F * stiffest));
    const float ratio = (high - low) / (high + low);
    const Integration how{2.0F / (high + low), ratio * ratio, 2.0F / (high + low), kLongestRelaxWay * edge_m_};
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
    // As long as the slow modes take to be seen above what floats round off.
    const int wanted = std::clamp(static_cast<int>(high / low), kRelaxInterval, kRelaxLongest);
    const int interval = std::clamp(options.max_steps - out.steps, 2, wanted);
    run(interval - 2);
    std::copy(velocity_.begin(), velocity_.end(), velocity_before_.begin());
    run(1);
    out.steps += interval;
    const double way = way_left(how);
    out.residual = std::max({unbalanced(how), way, std::min(way_before, 1.0)});
    way_before = way;
    if (out.residual < options.tolerance && !runs_away(how)) {
      out.converged = inverted_elements() == 0; // a fold that stands is no answer
      break;
    }
    const float seen = slowest_mode(); // not positive: lost in what floats round off, or not yet a minimum's
    slowest = seen > 0.0F ? std::clamp(seen, 0.5F * slowest, 4.0F * slowest) : 1.5F * slowest;
    slowest = std::clamp(slowest, 1e-8F, 1.0F);
  }
  stop_motion();
  settle_prony(options.relaxed);
  return out;
}

// The history that belongs to the answer of relax(): nothing has relaxed yet, or all of it.
void ExplicitSolver::settle_prony(bool relaxed) noexcept {
  if (!relaxed || prony_.empty()) {
    std::fill(relaxed_.begin(), relaxed_.end(), RelaxedPack{});
    return;
  }
  for (std::size_t k = 0; k < prony_.size(); ++k) {
    prony_[k] = {0.0F, static_cast<float>(material_.prony[k].share)};
  }
  const auto shear = static_cast<float>(material_.shear_Pa());
  team_->run([&](int thread) { evaluate(thread, displacement_, true, shear); });
}

// Rayleigh's quotient du K du / du M du of the motion du of the latest interval: what floats round off the forces would
// hide the slow modes in the motion of one step.
float ExplicitSolver::slowest_mode() const noexcept {
  double work = 0.0;
  double inertia = 0.0;
  for (std::size_t i = 0; i < displacement_.size(); ++i) {
    const NodeVector du = difference(displacement_[i], displacement_before_[i]);
    work += static_cast<double>(dot(du, difference(force_before_[i], elastic_[i])));
    inertia += static_cast<double>(0.25F * stiffness_bound_N_m_[i] * dot(du, du));
  }
  return inertia > 0.0 ? static_cast<float>(work / inertia) : 0.0F;
}

// What the last step still changed, as a force, against the forces that hold the tissue: contacts and supports
// included, since what they balance does not move. Less what the rounding of displacements to floats makes of itself.
double ExplicitSolver::unbalanced(const Integration &how) const noexcept {
  double rest = 0.0;
  double rounding = 0.0;
  double acting = 0.0;
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    const NodeVector &now = velocity_[i];
    const float mass = 0.25F * stiffness_bound_N_m_[i] / how.pull;
    const NodeVector push = difference(now, scaled(velocity_before_[i], how.keep));
    rest += static_cast<double>(mass * mass * dot(push, push));
    const float least = kNothing * edge_m_ * stiffness_bound_N_m_[i];
    acting += static_cast<double>(dot(elastic_[i], elastic_[i]) + least * least);
    const float noise = kRounding * stiffness_bound_N_m_[i];
    rounding += static_cast<double>(noise * noise * dot(displacement_[i], displacement_[i]));
  }
  return rest > 0.0 ? std::sqrt(std::max(rest - rounding, 0.0) / acting) : 0.0;
}

// A node was held back, and not because it presses on a contact that then put it back where it was.
bool ExplicitSolver::runs_away(const Integration &how) const noexcept {
  const float far_squared = 0.25F * how.longest_way * how.longest_way;
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    const NodeVector &v = velocity_[i];
    const bool pressed = std::isfinite(dot(elastic_[i], elastic_[i])) && how.step * how.step * dot(v, v) < far_squared;
    if (v.w == kLimited && !pressed) {
      return true;
    }
  }
  return false;
}

// How far the tissue will still go at the rate at which this iteration converges, against how far it has gone.
double ExplicitSolver::way_left(const Integration &how) const noexcept {
  double left = 0.0;
  double gone = 0.0;
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    left += static_cast<double>(mass_kg_[i] * dot(velocity_[i], velocity_[i]));
    const float least = kNothing * edge_m_;
    gone += static_cast<double>(mass_kg_[i] * (dot(displacement_[i], displacement_[i]) + least * least));
  }
  return left > 0.0
             ? static_cast<double>(how.step) / (1.0 - std::sqrt(static_cast<double>(how.keep))) * std::sqrt(left / gone)
             : 0.0;
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
  for (Share &share : shares_) {
    share.sums = {};
    share.volume_energy = 0.0;
    share.limited = 0;
  }
  step_s_ = step_at_rest_s_;
}

namespace {
Eigen::Vector3d to_double(const NodeVector &v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}
} // namespace

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
  for (const Share &share : shares_) {
    sum.elastic_J += share.volume_energy + share.sums.elastic_J;
  }
  for (std::size_t i = 0; i < velocity_.size(); ++i) {
    sum.kinetic_J += static_cast<double>(0.5F * mass_kg_[i] * dot(velocity_[i], velocity_[i]));
  }
  return sum;
}

int ExplicitSolver::limited_nodes() const noexcept {
  int sum = 0;
  for (const Share &share : shares_) {
    sum += share.limited;
  }
  return sum;
}

int ExplicitSolver::inverted_elements() const noexcept {
  int sum = 0;
  for (const Share &share : shares_) {
    sum += share.sums.inverted;
  }
  return sum;
}

bool ExplicitSolver::finite() const noexcept {
  // A sum is not finite if one of its terms is not.
  float sum = 0.0F;
  for (std::size_t i = 0; i < displacement_.size(); ++i) {
    const NodeVector &u = displacement_[i];
    const NodeVector &v = velocity_[i];
    sum += 0.0F * (u.x + u.y + u.z + v.x + v.y + v.z);
  }
  return std::isfinite(sum);
}

Eigen::Matrix3d ExplicitSolver::deformation_gradient(int element) const noexcept {
  const auto e = static_cast<std::size_t>(element);
  const ElementPack &pack = packs_[e / kPack];
  const std::size_t lane = e % kPack;
  const auto u = [&](int i) { return to_double(displacement_[static_cast<std::size_t>(pack.node[i][lane])]); };
  Eigen::Matrix3d f = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 3; ++i) {
    for (int d = 0; d < 3; ++d) {
      f.col(d) += (u(i + 1) - u(0)) * static_cast<double>(pack.gradient[i][d][lane]);
    }
  }
  return f;
}

Eigen::Matrix3d ExplicitSolver::cauchy_Pa(int element) const noexcept {
  const auto e = static_cast<std::size_t>(element);
  const std::size_t pack = e / kPack;
  const std::size_t lane = e % kPack;
  const Eigen::Matrix3d f = deformation_gradient(element);
  Eigen::Matrix3d shear = shear_stress_Pa(material_, f);
  for (std::size_t k = 0; k < prony_.size(); ++k) {
    const auto s = [&](int i) { return static_cast<double>(relaxed_[pack * prony_.size() + k].stress_Pa[i][lane]); };
    Eigen::Matrix3d taken;
    taken << s(0), s(5), s(4), s(5), s(1), s(3), s(4), s(3), s(2);
    shear -= taken;
  }
  double pressure = options_.own_pressure * pressure_Pa(material_, f);
  for (const auto &corner : packs_[pack].node) {
    pressure += 0.25 * static_cast<double>(displacement_[static_cast<std::size_t>(corner[lane])].w);
  }
  return bregma::tissue::cauchy_Pa(material_, f, shear, pressure);
}

} // namespace bregma::tissue
