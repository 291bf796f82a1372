#include "tests/support/tissue_hertz.hpp"

#include <cmath>
#include <vector>

#include "algorithms/tissue/contact/probe_contact.hpp"
#include "algorithms/tissue/material/units.hpp"
#include "tests/support/tissue_meshes.hpp"

namespace bregma::test {
namespace {

constexpr double kQuarters = 4.0;

// A quarter of the half space: a block whose coordinates are stretched away from the contact. The surface is the plane
// z = 0, the axis is x = y = 0.
tissue::TetMesh quarter_of_half_space(const HertzMesh &mesh, double &size_mm) {
  const int cells = mesh.even_cells + mesh.growing_cells;
  std::vector<double> at_mm{0.0};
  double cell_mm = mesh.cell_mm;
  for (int i = 0; i < cells; ++i) {
    cell_mm *= i < mesh.even_cells ? 1.0 : mesh.growth;
    at_mm.push_back(at_mm.back() + cell_mm);
  }
  size_mm = at_mm.back();
  const auto drawn_out = [&](double cell) { return at_mm[static_cast<std::size_t>(std::lround(cell))]; };
  tissue::TetMesh out = tissue::block_mesh({cells, cells, cells}, Eigen::Vector3d::Constant(cells));
  for (Eigen::Vector3d &node : out.nodes_mm) {
    node = {drawn_out(node.x()), drawn_out(node.y()), -drawn_out(cells - node.z())};
  }
  return out;
}

// Contact points share nodes, so the impulses vary between steps and relax() never reports convergence. The mean over a
// few hundred steps is used instead, as in the brain model.
class SmoothedContact final : public tissue::Contact {
public:
  explicit SmoothedContact(tissue::SurfaceContact &contact) : contact_(&contact) {}
  void apply(const tissue::NodeMotion &nodes) noexcept override {
    contact_->apply(nodes);
    down_N_ += kFollow * (static_cast<double>(-contact_->force_N().z()) - down_N_);
  }
  [[nodiscard]] double down_N() const { return down_N_; }

private:
  static constexpr double kFollow = 0.01;
  tissue::SurfaceContact *contact_;
  double down_N_ = 0.0;
};

} // namespace

HertzAnswer hertz(double sphere_mm, double depth_mm, double poisson, const HertzMesh &mesh, int steps,
                  const tissue::SolverOptions &options) {
  HertzAnswer out;
  const tissue::TetMesh block = quarter_of_half_space(mesh, out.size_mm);
  const tissue::Material material = brain(tissue::Law::kNeoHookean, poisson);
  tissue::ExplicitSolver solver(block, material, options);
  const std::vector<int> foot = nodes_at(block, 2, -out.size_mm);
  for (const int node : foot) {
    solver.fix(node);
  }
  for (const int node : nodes_at(block, 0, 0.0)) {
    solver.fix(node, tissue::kAxisX);
  }
  for (const int node : nodes_at(block, 1, 0.0)) {
    solver.fix(node, tissue::kAxisY);
  }
  const tissue::TetBoundary boundary = tissue::boundary_of(block);
  tissue::SurfaceContact contact(
      block, boundary, {.friction = 0.0, .spacing_mm = 0.5 * mesh.cell_mm, .reach_mm = 0.0, .capacity = 60'000});
  SmoothedContact smoothed(contact);
  solver.set_contacts({&smoothed});
  contact.set_active(true);
  tissue::PlacedProbe probe;
  probe.radius_m = static_cast<float>(sphere_mm / tissue::kMetre);
  probe.tip_m = tissue::to_metres({0.0, 0.0, -depth_mm});
  contact.place(probe);
  contact.search(solver);
  const auto support_N = [&] {
    double sum_N = 0.0;
    for (const int node : foot) {
      sum_N -= solver.elastic_force_N(node).z();
    }
    return kQuarters * sum_N;
  };
  (void)solver.relax({1e-4, 2 * steps / 3, false});
  const double before_N = support_N();
  (void)solver.relax({1e-4, steps / 3, false});

  out.elements = solver.elements();
  out.contact_radius_mm = std::sqrt(sphere_mm * depth_mm);
  const double reference_N = 4.0 / 3.0 * material.young_Pa / (1.0 - poisson * poisson) *
                             std::sqrt(sphere_mm / tissue::kMetre) * std::pow(depth_mm / tissue::kMetre, 1.5);
  out.contact_N = {kQuarters * smoothed.down_N(), reference_N};
  out.support_N = {support_N(), reference_N};
  out.unsettled = std::abs(out.support_N.value / before_N - 1.0);
  return out;
}

} // namespace bregma::test
