#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

#include "algorithms/tissue/probe_contact.hpp"

namespace bregma::tissue {
namespace {

constexpr int kCutSweeps = 4; // of Gauss-Seidel in a step

} // namespace

CutContact::CutContact(const TetMesh &mesh, const TetLocator &locator, double spacing_mm, double tip_radius_mm)
    : mesh_(&mesh), locator_(&locator), spacing_m_(static_cast<float>(spacing_mm / 1000.0)),
      tip_radius_m_(static_cast<float>(tip_radius_mm / 1000.0)) {
  held_.reserve(kMostHeld);
}

void CutContact::begin(int tetrahedron) noexcept {
  active_ = fresh_ = true;
  guess_ = tetrahedron;
  held_.clear();
  tip_ = {};
}

void CutContact::end() noexcept {
  active_ = false;
  held_.clear();
  length_ = 0.0F;
}

CutContact::Grip CutContact::grip(const NodeMotion &nodes, const MaterialPoint &point) const noexcept {
  const Eigen::Vector4i &t = mesh_->tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
  Grip grip;
  Eigen::Vector3f at = Eigen::Vector3f::Zero();
  for (int k = 0; k < 4; ++k) {
    const auto node = static_cast<std::size_t>(t[k]);
    const auto share = static_cast<float>(point.share[k]);
    const NodeVector &v = nodes.velocity_m_s[node];
    at += share * nodes.position_m(t[k]);
    grip.slip += share * Eigen::Vector3f(v.x, v.y, v.z);
    grip.mobility += share * share * nodes.inverse_mass_per_kg[node].x;
  }
  grip.from_tip = at - probe_.tip_m;
  grip.slip -= probe_.velocity_m_s(grip.from_tip.dot(probe_.shaft));
  return grip;
}

void CutContact::push(const NodeMotion &nodes, const MaterialPoint &point,
                      const Eigen::Vector3f &impulse) const noexcept {
  const Eigen::Vector4i &t = mesh_->tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
  for (int k = 0; k < 4; ++k) {
    const float inverse_mass = nodes.inverse_mass_per_kg[static_cast<std::size_t>(t[k])].x;
    nodes.move(t[k], (static_cast<float>(point.share[k]) * inverse_mass * nodes.step_s) * impulse);
  }
}

void CutContact::find_tip(const NodeMotion &nodes) noexcept {
  const auto position = [&](int node) -> Eigen::Vector3d { return nodes.position_m(node).cast<double>(); };
  tip_ = locator_->walk(probe_.tip_m.cast<double>(), guess_, position);
  if (!tip_.inside()) {
    return;
  }
  guess_ = tip_.tetrahedron;
  tip_rest_.setZero();
  const Eigen::Vector4i &t = mesh_->tetrahedra[static_cast<std::size_t>(tip_.tetrahedron)];
  for (int k = 0; k < 4; ++k) {
    tip_rest_ += static_cast<float>(tip_.share[k]) * nodes.rest_m[static_cast<std::size_t>(t[k])];
  }
  const Eigen::Vector3f side = probe_.shaft.unitOrthogonal();
  const Eigen::Vector3f other = probe_.shaft.cross(side);
  for (std::size_t i = 0; i < kTipPoints; ++i) {
    Eigen::Vector3f at = probe_.tip_m;
    if (i > 0) {
      const float angle = static_cast<float>(i) * (std::numbers::pi_v<float> / 3.0F);
      at += tip_radius_m_ * (std::cos(angle) * side + std::sin(angle) * other);
    }
    tip_points_[i] = locator_->walk(at.cast<double>(), tip_.tetrahedron, position);
  }
}

void CutContact::hold_and_give_up(const NodeMotion &nodes) noexcept {
  const auto height = [&](const MaterialPoint &point) { return grip(nodes, point).from_tip.dot(probe_.shaft); };
  if (fresh_) {
    fresh_ = false;
    // From where the shaft comes out down to the tip; a blunt tip may stand just before the surface that it has broken.
    const auto position = [&](int node) -> Eigen::Vector3d { return nodes.position_m(node).cast<double>(); };
    int near = guess_;
    for (std::size_t i = 0; i < kMostHeld; ++i) {
      const float up = static_cast<float>(i) * spacing_m_;
      const Eigen::Vector3f at = probe_.tip_m + up * probe_.shaft;
      const MaterialPoint point = locator_->walk(at.cast<double>(), near, position);
      if (point.inside()) {
        near = point.tetrahedron;
        held_.insert(held_.begin(), point);
      } else if (up > probe_.radius_m) {
        break;
      }
    }
    return;
  }
  while (!held_.empty() && height(held_.back()) < 0.0F) {
    held_.pop_back();
  }
  if (tip_.inside() && held_.size() < kMostHeld && (held_.empty() || height(held_.back()) > spacing_m_)) {
    held_.push_back(tip_);
  }
}

void CutContact::apply(const NodeMotion &nodes) noexcept {
  tip_force_ = 0.0F;
  shaft_force_.setZero();
  if (!active_) {
    return;
  }
  find_tip(nodes);
  const bool was_inside = !held_.empty() || fresh_;
  hold_and_give_up(nodes);
  if (held_.empty()) {
    length_ = was_inside && tip_.inside() ? spacing_m_ : 0.0F;
  } else {
    length_ = std::max(grip(nodes, held_.front()).from_tip.dot(probe_.shaft), 1e-6F);
  }

  const float dt = nodes.step_s;
  constexpr float kShare = 1.0F / static_cast<float>(kCutSweeps); // of a step's friction, for one sweep
  const float most_rub = forces_.friction_N_per_m * spacing_m_ * dt * kShare;
  const float most_push = forces_.cutting_N * dt * kShare / static_cast<float>(kTipPoints);
  for (int sweep = 0; sweep < kCutSweeps; ++sweep) {
    for (const MaterialPoint &point : held_) {
      const Grip held = grip(nodes, point);
      if (held.mobility <= 0.0F) {
        continue;
      }
      // Sideways back onto the axis, along the shaft what friction can.
      const Eigen::Vector3f aside = held.from_tip - held.from_tip.dot(probe_.shaft) * probe_.shaft;
      const float rub = std::clamp(-held.slip.dot(probe_.shaft) / held.mobility, -most_rub, most_rub);
      const Eigen::Vector3f impulse = rub * probe_.shaft - aside / (held.mobility * dt);
      push(nodes, point, impulse);
      shaft_force_ += impulse / dt;
    }
    // The tip pushes and never pulls.
    for (std::size_t i = 0; tip_.inside() && most_push > 0.0F && i < kTipPoints; ++i) {
      if (!tip_points_[i].inside()) {
        continue;
      }
      const Grip held = grip(nodes, tip_points_[i]);
      const float along = held.slip.dot(probe_.shaft);
      if (held.mobility > 0.0F && along > 0.0F) {
        const float pushed = std::min(along / held.mobility, most_push);
        push(nodes, tip_points_[i], -pushed * probe_.shaft);
        tip_force_ += pushed / dt;
      }
    }
  }
}

} // namespace bregma::tissue
