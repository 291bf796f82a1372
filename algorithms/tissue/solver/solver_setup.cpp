// Setup of the solver from mesh and material: element packs, masses, work of the threads, the first step size.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <Eigen/LU>

#include "algorithms/parallel/team.hpp"
#include "algorithms/tissue/material/units.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {
namespace {

constexpr std::size_t kBlock = 64; // packs
constexpr int kFirstLook = 20;     // iterations for the stiffest mode of the tissue at rest

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

} // namespace

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
      !(options.element_pressure_fraction >= 0.0 && options.element_pressure_fraction <= 1.0)) {
    throw std::invalid_argument("solver options: threads at least 1, step_fraction in (0, 1], minimum_step_s and "
                                "damping_per_s not negative, element_pressure_fraction in [0, 1]");
  }
  const std::size_t nodes = mesh_.nodes_mm.size();
  team_ = std::make_unique<parallel::Team>(options.threads);
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

  parts_.resize(static_cast<std::size_t>(team_->size()));
  for (std::size_t t = 0; t < parts_.size(); ++t) {
    const auto part = [&](std::size_t count) {
      return Range{count * t / parts_.size(), count * (t + 1) / parts_.size()};
    };
    parts_[t].packs = part(packs_.size());
    parts_[t].nodes = part(nodes);
    parts_[t].volume_change.assign(nodes, 0.0F);
    parts_[t].force.assign(nodes, {});
  }

  build_masses(options.minimum_step_s);
  // Initial vector in which neighbours move in opposite directions, as in the fastest mode.
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
  reset(); // clears energies and pressures of the iteration
  save();
}

ExplicitSolver::~ExplicitSolver() = default;

// Neighbours are placed in consecutive packs instead of one pack, where their sums at a common node would depend on
// each other. A block of packs contains tetrahedra that are adjacent in the mesh, which keeps a thread's memory local.
ExplicitSolver::Slot ExplicitSolver::slot_of(std::size_t element) const noexcept {
  const std::size_t first = element / (kPack * kBlock) * kBlock;
  const std::size_t packs = std::min(kBlock, packs_.size() - first);
  const std::size_t in_block = element - kPack * first;
  return {first + in_block % packs, in_block / packs};
}

void ExplicitSolver::build_packs() {
  const std::size_t elements = mesh_.tetrahedra.size();
  packs_.assign((elements + kPack - 1) / kPack, {});
  volume_m3_.assign(rest_.size(), 0.0F);
  stiffness_bound_N_m_.assign(rest_.size(), 0.0F);
  for (std::size_t e = 0; e < packs_.size() * kPack; ++e) {
    const auto [slot, lane] = slot_of(e);
    ElementPack &pack = packs_[slot];
    const Eigen::Vector4i &t = mesh_.tetrahedra[std::min(e, elements - 1)];
    for (int i = 0; i < 4; ++i) {
      pack.node[i][lane] = t[i];
    }
    if (e >= elements) {
      continue; // pads the last pack
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
// bound (dt / 2)^2 allows the step dt. This defines the masses of relax(), where all nodes allow the step 1, and those
// of mass scaling.
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
  added_mass_fraction_ = after / before - 1.0;
}

} // namespace bregma::tissue
