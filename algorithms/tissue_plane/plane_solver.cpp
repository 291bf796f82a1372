#include "algorithms/tissue_plane/plane_solver.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <Eigen/LU>

#include "algorithms/tissue_plane/plane_mesher.hpp"

namespace bregma::tissue_plane {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

// Steps between two updates of the masses from the deformed triangles' stiffness.
constexpr int kMassesEvery = 50;
// Margin on the bound of scale_masses(), which omits the geometric stiffness.
constexpr double kMassMargin = 1.15;
constexpr int kCheckEvery = 5;
// Held nodes move by this fraction of the mesh's smallest height per step, so that no triangle is inverted before its
// other nodes can follow.
constexpr double kHeldStep = 0.02;
// Maximum move of free nodes per step, as a fraction of that height: nodes that spring back do not pass neighbours.
constexpr double kMaxStep = 0.1;

} // namespace

PlaneSolver::PlaneSolver(const PlaneMesh &mesh, const tissue::Material &material, const PlaneSettings &settings)
    : mesh_(mesh), settings_(settings) {
  check(mesh);
  check(material);
  if (!(settings.shear_fraction > 0.0 && settings.shear_fraction <= 1.0)) {
    throw std::invalid_argument("shear_fraction = " + std::to_string(settings.shear_fraction) +
                                ", must be above 0 and at most 1");
  }
  law_ = {material.law, settings.shear_fraction * material.shear_Pa(), material.bulk_Pa(), material.ogden_alpha};
  const std::size_t nodes = mesh.nodes_mm.size();
  for (const Vector2d &p : mesh.nodes_mm) {
    x_.push_back(1e-3 * p);
  }
  target_ = x_;
  next_ = x_;
  v_.assign(nodes, Vector2d::Zero());
  internal_ = last_internal_ = external_ = forces_ = v_;
  free_.assign(nodes, Vector2d::Ones());
  mass_.assign(nodes, 0.0);
  node_area_m2_ = node_ratio_ = node_pressure_ = mass_;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    Triangle triangle;
    std::copy(t.begin(), t.end(), triangle.nodes);
    const Matrix2d edges = (Matrix2d() << at(x_, t[1]) - at(x_, t[0]), at(x_, t[2]) - at(x_, t[0])).finished();
    triangle.inverse = edges.inverse();
    triangle.area_m2 = 0.5 * edges.determinant();
    triangles_.push_back(triangle);
    for (const int n : t) {
      at(node_area_m2_, n) += triangle.area_m2 / 3.0;
    }
  }
  held_step_m_ = 1e-3 * kHeldStep * quality_of(mesh).smallest_height_mm;
  gradients_.assign(triangles_.size(), Matrix2d::Identity());
  thickness_.assign(triangles_.size(), 1.0);
  ratio_ = thickness_;
  compute_forces();
}

void PlaneSolver::hold(int node, int axis, double displacement_mm) {
  at(free_, node)[axis] = 0.0;
  at(target_, node)[axis] = 1e-3 * (at(mesh_.nodes_mm, node)[axis] + displacement_mm);
}

void PlaneSolver::hold(int node, const Vector2d &displacement_mm) {
  hold(node, 0, displacement_mm.x());
  hold(node, 1, displacement_mm.y());
}

void PlaneSolver::set_force(int node, const Vector2d &force_N_m) { at(forces_, node) = force_N_m; }

void PlaneSolver::set_pressure(std::span<const Eigen::Vector2i> edges, double pressure_Pa) {
  edges_.assign(edges.begin(), edges.end());
  pressure_Pa_ = pressure_Pa;
}

void PlaneSolver::displace(int node, const Vector2d &displacement_mm) {
  at(x_, node) = 1e-3 * (at(mesh_.nodes_mm, node) + displacement_mm);
}

int PlaneSolver::split(int node, std::span<const int> triangles) {
  const int fresh = static_cast<int>(x_.size());
  mesh_.nodes_mm.push_back(Vector2d(at(mesh_.nodes_mm, node)));
  for (auto *values : {&x_, &target_, &next_, &free_}) {
    values->push_back(Vector2d(at(*values, node)));
  }
  for (auto *values : {&v_, &internal_, &last_internal_, &external_, &forces_}) {
    values->push_back(Vector2d::Zero());
  }
  for (auto *values : {&mass_, &node_area_m2_, &node_ratio_, &node_pressure_}) {
    values->push_back(0.0);
  }
  for (const int e : triangles) {
    Triangle &t = at(triangles_, e);
    for (int k = 0; k < 3; ++k) {
      if (t.nodes[k] == node) {
        t.nodes[k] = fresh;
        at(mesh_.triangles, e)[k] = fresh;
        at(node_area_m2_, node) -= t.area_m2 / 3.0;
        at(node_area_m2_, fresh) += t.area_m2 / 3.0;
      }
    }
  }
  compute_forces();
  return fresh;
}

Matrix2d PlaneSolver::gradient(const Triangle &t) const {
  const Vector2d &origin = at(x_, t.nodes[0]);
  return (Matrix2d() << at(x_, t.nodes[1]) - origin, at(x_, t.nodes[2]) - origin).finished() * t.inverse;
}

void PlaneSolver::collect_volumes() {
  const bool stress_free_across = settings_.state == PlaneState::kStress;
  std::fill(node_ratio_.begin(), node_ratio_.end(), 0.0);
  inverted_ = 0;
  for (std::size_t e = 0; e < triangles_.size(); ++e) {
    const Triangle &t = triangles_[e];
    const Matrix2d f = gradient(t);
    gradients_[e] = f;
    inverted_ += f.determinant() <= 0.0 ? 1 : 0;
    if (stress_free_across) {
      thickness_[e] = plane_law::free_thickness(law_, f, thickness_[e]);
    }
    ratio_[e] = plane_law::volume_ratio(law_, f, thickness_[e]);
    const double part = ratio_[e] * t.area_m2 / 3.0;
    for (const int n : t.nodes) {
      at(node_ratio_, n) += part;
    }
  }
  for (std::size_t n = 0; n < node_ratio_.size(); ++n) {
    node_ratio_[n] /= node_area_m2_[n];
    node_pressure_[n] = law_.bulk_Pa * (node_ratio_[n] - 1.0);
  }
}

double PlaneSolver::pressure(std::size_t triangle) const {
  if (settings_.state == PlaneState::kStress) {
    return law_.bulk_Pa * (ratio_[triangle] - 1.0);
  }
  const auto &n = triangles_[triangle].nodes;
  return (at(node_pressure_, n[0]) + at(node_pressure_, n[1]) + at(node_pressure_, n[2])) / 3.0;
}

void PlaneSolver::compute_forces() {
  collect_volumes();
  std::fill(internal_.begin(), internal_.end(), Vector2d::Zero());
  for (std::size_t e = 0; e < triangles_.size(); ++e) {
    const Triangle &t = triangles_[e];
    const Matrix2d &f = gradients_[e];
    const double p = pressure(e);
    Matrix2d piola = plane_law::shear_piola(law_, f, thickness_[e]);
    if (law_.law == tissue::Law::kLinear) {
      piola.diagonal().array() += p;
    } else {
      piola += (p * thickness_[e]) * plane_law::cofactor(f);
    }
    const Matrix2d forces = (t.area_m2 * piola) * t.inverse.transpose();
    at(internal_, t.nodes[0]) -= forces.col(0) + forces.col(1);
    at(internal_, t.nodes[1]) += forces.col(0);
    at(internal_, t.nodes[2]) += forces.col(1);
  }
  external_ = forces_;
  load_edges();
}

void PlaneSolver::load_edges() {
  for (const Eigen::Vector2i &edge : edges_) {
    const Vector2d along = settings_.follower
                               ? Vector2d(at(x_, edge[1]) - at(x_, edge[0]))
                               : Vector2d(1e-3 * (at(mesh_.nodes_mm, edge[1]) - at(mesh_.nodes_mm, edge[0])));
    const Vector2d half = 0.5 * pressure_Pa_ * Vector2d(-along.y(), along.x()); // towards the body, on the left
    at(external_, edge[0]) += half;
    at(external_, edge[1]) += half;
  }
}

// The step is 1; masses are chosen so that it is stable. By Gershgorin's theorem on 2 x 2 blocks the highest frequency
// of M^-1 K is below 2 if M_a >= 1/4 sum_b |K_ab|, and a triangle's block is at most V (wave modulus) |g_a| |g_b|.
void PlaneSolver::scale_masses() {
  std::fill(mass_.begin(), mass_.end(), 0.0);
  for (std::size_t e = 0; e < triangles_.size(); ++e) {
    const Triangle &t = triangles_[e];
    const bool linear = law_.law == tissue::Law::kLinear;
    const Matrix2d f = linear ? Matrix2d::Identity() : gradients_[e];
    const double det = std::max(f.determinant(), plane_law::kMinVolumeRatio);
    // Gradients of the shape functions in the deformed triangle: rows of (f edges)^-1.
    const Matrix2d now = t.inverse * plane_law::cofactor(f).transpose() / det;
    const double b = now.row(0).norm();
    const double c = now.row(1).norm();
    const double a = (now.row(0) + now.row(1)).norm();
    const plane_law::Squares squares = plane_law::principal_squares(f);
    const double exponent = law_.law == tissue::Law::kOgden ? std::abs(law_.alpha) : 2.0;
    const double stretch = linear ? 1.0 : std::pow(std::max(squares.first, 1.0 / squares.second), 0.5 * exponent);
    const double j = linear ? 1.0 : ratio_[e];
    const double modulus = law_.bulk_Pa * std::max(1.0, 2.0 * j - 1.0) + 4.0 / 3.0 * law_.shear_Pa * stretch;
    const double k = 0.25 * kMassMargin * t.area_m2 * thickness_[e] * det * modulus * (a + b + c);
    at(mass_, t.nodes[0]) += k * a;
    at(mass_, t.nodes[1]) += k * b;
    at(mass_, t.nodes[2]) += k * c;
  }
}

// One step of central differences. unbalanced: the norm of all forces, including contact, on free nodes.
void PlaneSolver::move(double damping, double &unbalanced) {
  const double keep = (2.0 - damping) / (2.0 + damping);
  const double push = 2.0 / (2.0 + damping);
  const double max_move = kMaxStep / kHeldStep * held_step_m_;
  for (std::size_t n = 0; n < x_.size(); ++n) {
    Vector2d v = keep * v_[n] + (push / mass_[n]) * (external_[n] - internal_[n]);
    if (const double square = v.squaredNorm(); square > max_move * max_move) {
      v *= max_move / std::sqrt(square);
    }
    const Vector2d to_place = (target_[n] - x_[n]).cwiseMax(-held_step_m_).cwiseMin(held_step_m_);
    next_[n] = x_[n] + to_place + free_[n].cwiseProduct(v - to_place);
  }
  if (contact_ != nullptr) {
    contact_->project(next_);
  }
  double squares = 0.0;
  for (std::size_t n = 0; n < x_.size(); ++n) {
    const Vector2d v = next_[n] - x_[n];
    squares += (mass_[n] / push * free_[n].cwiseProduct(v - keep * v_[n])).squaredNorm();
    v_[n] = v;
    x_[n] += v;
  }
  unbalanced = std::sqrt(squares);
}

double PlaneSolver::holding_force() const {
  double reactions = 0.0;
  double loads = 0.0;
  for (std::size_t n = 0; n < x_.size(); ++n) {
    reactions += (internal_[n] - external_[n]).squaredNorm();
    loads += external_[n].squaredNorm();
  }
  // Forces below a millionth of the shear modulus times 1 mm are rounding errors.
  return std::max({std::sqrt(reactions), std::sqrt(loads), 1e-9 * law_.shear_Pa});
}

PlaneRelaxationResult PlaneSolver::relax(const PlaneRelaxationOptions &limits) {
  double distance_m = 0.0; // remaining distance of held nodes
  for (std::size_t n = 0; n < x_.size(); ++n) {
    distance_m =
        std::max(distance_m, (Vector2d::Ones() - free_[n]).cwiseProduct(target_[n] - x_[n]).cwiseAbs().maxCoeff());
    v_[n].setZero();
  }
  const double steps_needed = std::ceil(distance_m / held_step_m_);
  compute_forces();
  PlaneRelaxationResult out;
  for (out.steps = 1; out.steps <= limits.max_steps; ++out.steps) {
    if (out.steps % kMassesEvery == 1) {
      scale_masses();
    }
    double unbalanced = 0.0;
    move(2.0 * std::sqrt(lowest_), unbalanced);
    std::swap(internal_, last_internal_);
    compute_forces();

    // Rayleigh's quotient of the motion: as fast modes decay, it approaches the slowest mode.
    double stiffness = 0.0;
    double inertia = 0.0;
    for (std::size_t n = 0; n < x_.size(); ++n) {
      const Vector2d v = free_[n].cwiseProduct(v_[n]);
      stiffness += v.dot(internal_[n] - last_internal_[n]);
      inertia += mass_[n] * v.squaredNorm();
    }
    lowest_ = inertia > 0.0 ? std::clamp(stiffness / inertia, 0.0, 0.5) : lowest_;

    if (!std::isfinite(unbalanced)) {
      out.residual = unbalanced;
      out.inverted = inverted_;
      return out;
    }
    if (out.steps % kCheckEvery == 0 && out.steps > steps_needed && (contact_ == nullptr || contact_->arrived())) {
      out.residual = unbalanced / holding_force();
      if (out.residual < limits.tolerance) {
        out.converged = true;
        break;
      }
    }
  }
  out.inverted = inverted_;
  return out;
}

PlaneStress PlaneSolver::stress(int triangle) const {
  const auto e = static_cast<std::size_t>(triangle);
  return plane_law::cauchy(law_, gradients_[e], thickness_[e], pressure(e));
}

std::vector<PlaneStress> PlaneSolver::nodal_stress() const {
  std::vector<PlaneStress> out(x_.size());
  for (std::size_t e = 0; e < triangles_.size(); ++e) {
    const PlaneStress s = stress(static_cast<int>(e));
    for (const int n : triangles_[e].nodes) {
      const double weight = triangles_[e].area_m2 / 3.0 / at(node_area_m2_, n);
      PlaneStress &sum = at(out, n);
      sum.xx_Pa += weight * s.xx_Pa;
      sum.yy_Pa += weight * s.yy_Pa;
      sum.zz_Pa += weight * s.zz_Pa;
      sum.xy_Pa += weight * s.xy_Pa;
    }
  }
  return out;
}

PlaneStress PlaneSolver::stress_at(const Vector2d &at_rest_mm) const {
  constexpr double kEdge = -1e-9; // a point on an edge belongs to both triangles
  for (const Triangle &t : triangles_) {
    const Vector2d bc = t.inverse * (1e-3 * (at_rest_mm - at(mesh_.nodes_mm, t.nodes[0])));
    const double weights[3] = {1.0 - bc.sum(), bc.x(), bc.y()};
    if (*std::min_element(weights, weights + 3) < kEdge) {
      continue;
    }
    const std::vector<PlaneStress> nodal = nodal_stress();
    PlaneStress out;
    for (int k = 0; k < 3; ++k) {
      const PlaneStress &s = at(nodal, t.nodes[k]);
      out.xx_Pa += weights[k] * s.xx_Pa;
      out.yy_Pa += weights[k] * s.yy_Pa;
      out.zz_Pa += weights[k] * s.zz_Pa;
      out.xy_Pa += weights[k] * s.xy_Pa;
    }
    return out;
  }
  throw std::invalid_argument("stress_at: (" + std::to_string(at_rest_mm.x()) + ", " + std::to_string(at_rest_mm.y()) +
                              ") mm is outside the mesh");
}

} // namespace bregma::tissue_plane
