#include "algorithms/tissue/brain_shift.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/contact/falx.hpp"
#include "algorithms/tissue/material/units.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

constexpr double kGravity_m_s2 = 9.80665;

Vector3d direction(const char *name, const Vector3d &given) {
  const double length = given.norm();
  if (!std::isfinite(length) || length < 1e-9) {
    throw std::invalid_argument(std::string("brain shift: ") + name + " has the length " + std::to_string(length) +
                                ", must be a direction");
  }
  return given / length;
}

void check(const BrainShiftOptions &options) {
  const auto not_negative = [](const char *name, double value) {
    if (!std::isfinite(value) || value < 0.0) {
      throw std::invalid_argument(std::string("brain shift: ") + name + " = " + std::to_string(value) +
                                  ", must not be negative");
    }
  };
  not_negative("fluid_drop_mm", options.fluid_drop_mm.value_or(0.0));
  not_negative("stem_mm", options.stem_mm);
  not_negative("tissue_kg_m3", options.tissue_kg_m3);
  not_negative("fluid_kg_m3", options.fluid_kg_m3);
  not_negative("deep_mm", options.deep_mm);
}

bool open_at(const SkullOptions &skull, const Vector3d &rest_mm) {
  return (rest_mm - skull.craniotomy.centre_mm).norm() < skull.craniotomy.radius_mm;
}

// The fluid's level, measured upwards from the origin.
struct Level {
  double height_mm = 0.0;
  double drop_mm = 0.0;
};

Level level_of(const TetMesh &mesh, const BrainShiftOptions &options, const Vector3d &down) {
  const TetBoundary boundary = boundary_of(mesh);
  double highest = -INFINITY;
  double edge = INFINITY;
  for (const int node : boundary.nodes) {
    const Vector3d &at = mesh.nodes_mm[static_cast<std::size_t>(node)];
    const double height = -down.dot(at);
    highest = std::max(highest, height);
    if (open_at(options.skull, at)) {
      edge = std::min(edge, height);
    }
  }
  const double to_edge = std::isfinite(edge) ? highest - edge : 0.0;
  const double drop = options.fluid_drop_mm.value_or(to_edge);
  return {highest - drop, drop};
}

// Fraction of a tetrahedron's volume below a level, from its corners' heights above that level.
double fraction_below(std::array<double, 4> height) {
  std::sort(height.begin(), height.end());
  const auto [a, b, c, d] = height;
  // Fraction of the edge from p (below) to q (above).
  const auto cut = [](double p, double q) { return p / (p - q); };
  if (d <= 0.0) {
    return 1.0;
  }
  if (a >= 0.0) {
    return 0.0;
  }
  if (b >= 0.0) { // only the lowest corner is below
    return cut(a, b) * cut(a, c) * cut(a, d);
  }
  if (c <= 0.0) { // all except the highest corner are below
    return 1.0 - cut(d, a) * cut(d, b) * cut(d, c);
  }
  // A wedge below, as three tetrahedra.
  return cut(b, c) * cut(b, d) + (1.0 - cut(b, c)) * cut(a, c) * cut(a, d) + cut(a, d) * cut(b, c) * (1.0 - cut(b, d));
}

// The change of the load on the nodes at their present positions.
class ShiftLoad {
public:
  ShiftLoad(const TetMesh &mesh, const BrainShiftOptions &options)
      : mesh_((check(options), mesh)), down_(direction("gravity", options.gravity)),
        level_(level_of(mesh, options, down_)), tissue_N_m3_(kGravity_m_s2 * options.tissue_kg_m3),
        fluid_N_m3_(kGravity_m_s2 * options.fluid_kg_m3),
        before_N_m3_((tissue_N_m3_ - fluid_N_m3_) * direction("gravity_imaged", options.gravity_imaged)) {
    volumes_m3_.reserve(mesh.tetrahedra.size());
    for (const Eigen::Vector4i &t : mesh.tetrahedra) {
      const auto corner = [&](int i) -> const Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
      const auto edge_m = [&](int i) -> Vector3d { return (corner(i) - corner(0)) / kMetre; };
      volumes_m3_.push_back(edge_m(1).cross(edge_m(2)).dot(edge_m(3)) / 6.0);
    }
  }

  [[nodiscard]] double fluid_drop_mm() const noexcept { return level_.drop_mm; }

  // position_mm(node): its present position.
  template <class Position> void at(const Position &position_mm, std::vector<Vector3d> &load_N) const noexcept {
    std::fill(load_N.begin(), load_N.end(), Vector3d::Zero());
    for (std::size_t e = 0; e < volumes_m3_.size(); ++e) {
      const Eigen::Vector4i &t = mesh_.tetrahedra[e];
      std::array<double, 4> height{};
      for (int i = 0; i < 4; ++i) {
        height[static_cast<std::size_t>(i)] = -down_.dot(position_mm(t[i])) - level_.height_mm;
      }
      const Vector3d now_N_m3 = (tissue_N_m3_ - fraction_below(height) * fluid_N_m3_) * down_;
      for (int i = 0; i < 4; ++i) {
        load_N[static_cast<std::size_t>(t[i])] += 0.25 * volumes_m3_[e] * (now_N_m3 - before_N_m3_);
      }
    }
  }

private:
  const TetMesh &mesh_;
  Vector3d down_;
  Level level_;
  double tissue_N_m3_, fluid_N_m3_;
  Vector3d before_N_m3_;
  std::vector<double> volumes_m3_;
};

// Keeps the load consistent with the tissue's position during relaxation. The fluid's level is constant while tissue
// sinks below it. A load fixed to each piece of tissue would rotate the brain until its heavy side is down.
class Fluid final : public Contact {
public:
  Fluid(const ShiftLoad &load, ExplicitSolver &solver)
      : load_(load), solver_(solver), load_N_(static_cast<std::size_t>(solver.nodes())) {
    put([&](int node) -> const Vector3d & { return solver.mesh().nodes_mm[static_cast<std::size_t>(node)]; });
  }

  void apply(const NodeMotion &nodes) noexcept override {
    if (++steps_ % kLookAgain == 0) {
      put([&](int node) -> Vector3d { return kMetre * nodes.position_m(node).cast<double>(); });
    }
  }

  [[nodiscard]] const std::vector<Vector3d> &load_N() const noexcept { return load_N_; }

private:
  static constexpr int kLookAgain = 10; // steps: tissue does not move far in fewer

  template <class Position> void put(const Position &position_mm) noexcept {
    load_.at(position_mm, load_N_);
    for (int i = 0; i < solver_.nodes(); ++i) {
      solver_.set_force_N(i, load_N_[static_cast<std::size_t>(i)]);
    }
  }

  const ShiftLoad &load_;
  ExplicitSolver &solver_;
  std::vector<Vector3d> load_N_;
  int steps_ = 0;
};

void hold_stem(ExplicitSolver &solver, double stem_mm) {
  const std::vector<Vector3d> &nodes_mm = solver.mesh().nodes_mm;
  const Vector3d lowest_mm =
      *std::min_element(nodes_mm.begin(), nodes_mm.end(), [](const auto &a, const auto &b) { return a.z() < b.z(); });
  for (int i = 0; i < solver.nodes(); ++i) {
    if ((nodes_mm[static_cast<std::size_t>(i)] - lowest_mm).norm() < stem_mm) {
      solver.fix(i);
    }
  }
}

void keep_farthest(ShiftedPoint &point, int node, const Vector3d &rest_mm, const Vector3d &displacement_mm) {
  if (point.node < 0 || displacement_mm.norm() > point.displacement_mm.norm()) {
    point = {node, rest_mm, displacement_mm};
  }
}

} // namespace

std::vector<Vector3d> shift_load_N(const TetMesh &mesh, const BrainShiftOptions &options) {
  std::vector<Vector3d> load_N(mesh.nodes_mm.size());
  ShiftLoad(mesh, options)
      .at([&](int node) -> const Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(node)]; }, load_N);
  return load_N;
}

BrainShift predict_shift(const TetMesh &mesh, const BrainShiftOptions &options) {
  ExplicitSolver solver(mesh, options.material, options.solver);
  const ShiftLoad load(mesh, options);
  const TetBoundary boundary = boundary_of(mesh);
  Skull skull(mesh, boundary, options.skull);
  skull.apply_supports(solver);
  hold_stem(solver, options.stem_mm);
  Fluid fluid(load, solver);
  std::vector<Contact *> contacts{&skull, &fluid};
  std::optional<Falx> falx;
  if (options.falx) {
    contacts.push_back(&falx.emplace(mesh, boundary, skull.surface()));
  }
  solver.set_contacts(std::move(contacts));

  BrainShift out;
  out.fluid_drop_mm = load.fluid_drop_mm();
  out.relaxation = solver.relax(options.relax);
  out.inverted_elements = solver.inverted_elements();
  for (const Vector3d &force_N : fluid.load_N()) {
    out.load_N += force_N;
  }

  out.displacement_mm.reserve(mesh.nodes_mm.size());
  for (int i = 0; i < solver.nodes(); ++i) {
    const Vector3d &rest_mm = mesh.nodes_mm[static_cast<std::size_t>(i)];
    out.displacement_mm.push_back(solver.displacement_mm(i));
    if (skull.surface().closest(rest_mm).distance_mm >= options.deep_mm) {
      keep_farthest(out.deep, i, rest_mm, out.displacement_mm.back());
    }
  }
  for (const int node : boundary.nodes) {
    const Vector3d &rest_mm = mesh.nodes_mm[static_cast<std::size_t>(node)];
    if (options.skull.craniotomy.radius_mm == 0.0 || open_at(options.skull, rest_mm)) {
      keep_farthest(out.surface, node, rest_mm, out.displacement_mm[static_cast<std::size_t>(node)]);
    }
  }
  return out;
}

} // namespace bregma::tissue
