#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

#include "algorithms/tissue/contact/probe_contact.hpp"

namespace bregma::tissue {
namespace {

constexpr int kCutSweeps = 4; // Gauss-Seidel sweeps per step

} // namespace

CutContact::CutContact(const TetMesh &mesh, const TetLocator &locator, double spacing_mm, double section_radius_mm)
    : mesh_(&mesh), locator_(&locator), spacing_m_(static_cast<float>(spacing_mm / 1000.0)),
      section_radius_m_(static_cast<float>(section_radius_mm / 1000.0)) {
  sections_.reserve(kMaxSections);
}

void CutContact::begin(int tetrahedron) noexcept {
  active_ = fresh_ = true;
  guess_ = tetrahedron;
  sections_.clear();
  tip_ = {};
}

void CutContact::end() noexcept {
  active_ = false;
  sections_.clear();
  length_ = 0.0F;
}

// ---- cross-sections ----

MaterialPoint CutContact::find(const NodeMotion &nodes, const Eigen::Vector3f &at_m, int guess) const noexcept {
  return locator_->walk(at_m.cast<double>(), guess,
                        [&](int node) -> Eigen::Vector3d { return nodes.position_m(node).cast<double>(); });
}

void CutContact::Section::add(const Eigen::Vector4i &tetrahedron, const MaterialPoint &point) noexcept {
  for (int k = 0; k < 4; ++k) {
    const auto end = node.begin() + count;
    const auto at = std::find(node.begin(), end, tetrahedron[k]);
    if (at == end) {
      node[static_cast<std::size_t>(count)] = tetrahedron[k];
      weight[static_cast<std::size_t>(count)] = 0.0F;
      ++count;
    }
    weight[static_cast<std::size_t>(at - node.begin())] += static_cast<float>(point.barycentric[k]);
  }
}

// The centre and six points around it, as far as they are in the mesh.
CutContact::Section CutContact::section_at(const NodeMotion &nodes, const MaterialPoint &middle,
                                           const Eigen::Vector3f &at_m) const noexcept {
  constexpr int kAround = static_cast<int>(kSectionPoints) - 1;
  const auto nodes_of = [this](const MaterialPoint &point) -> const Eigen::Vector4i & {
    return mesh_->tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
  };
  Section section;
  section.add(nodes_of(middle), middle);
  int points = 1;
  const Eigen::Vector3f side = probe_.shaft.unitOrthogonal();
  const Eigen::Vector3f other = probe_.shaft.cross(side);
  for (int i = 0; i < kAround; ++i) {
    const float angle = static_cast<float>(i) * (2.0F * std::numbers::pi_v<float> / static_cast<float>(kAround));
    const MaterialPoint point =
        find(nodes, at_m + section_radius_m_ * (std::cos(angle) * side + std::sin(angle) * other), middle.tetrahedron);
    if (point.inside()) {
      section.add(nodes_of(point), point);
      ++points;
    }
  }
  for (int i = 0; i < section.count; ++i) {
    section.weight[static_cast<std::size_t>(i)] /= static_cast<float>(points);
  }
  const Eigen::Vector3f from_tip = grip(nodes, section).from_tip;
  section.offset = from_tip - from_tip.dot(probe_.shaft) * probe_.shaft;
  return section;
}

CutContact::Grip CutContact::grip(const NodeMotion &nodes, const Section &section) const noexcept {
  Grip grip;
  Eigen::Vector3f at = Eigen::Vector3f::Zero();
  for (std::size_t k = 0; k < static_cast<std::size_t>(section.count); ++k) {
    const auto node = static_cast<std::size_t>(section.node[k]);
    const NodeVector &v = nodes.velocity_m_s[node];
    at += section.weight[k] * nodes.position_m(section.node[k]);
    grip.slip += section.weight[k] * Eigen::Vector3f(v.x, v.y, v.z);
    grip.mobility += section.weight[k] * section.weight[k] * nodes.inverse_mass_per_kg[node].x;
  }
  grip.from_tip = at - probe_.tip_m;
  grip.slip -= probe_.velocity_m_s(grip.from_tip.dot(probe_.shaft));
  return grip;
}

void CutContact::push(const NodeMotion &nodes, const Section &section, const Eigen::Vector3f &impulse) const noexcept {
  for (std::size_t k = 0; k < static_cast<std::size_t>(section.count); ++k) {
    const float inverse_mass = nodes.inverse_mass_per_kg[static_cast<std::size_t>(section.node[k])].x;
    nodes.move(section.node[k], (section.weight[k] * inverse_mass * nodes.step_s) * impulse);
  }
}

// ---- a step ----

void CutContact::find_tip(const NodeMotion &nodes) noexcept {
  tip_ = find(nodes, probe_.tip_m, guess_);
  if (!tip_.inside()) {
    return;
  }
  guess_ = tip_.tetrahedron;
  tip_rest_.setZero();
  const Eigen::Vector4i &t = mesh_->tetrahedra[static_cast<std::size_t>(tip_.tetrahedron)];
  for (int k = 0; k < 4; ++k) {
    tip_rest_ += static_cast<float>(tip_.barycentric[k]) * nodes.rest_m[static_cast<std::size_t>(t[k])];
  }
  tip_section_ = section_at(nodes, tip_, probe_.tip_m);
}

void CutContact::update_constraints(const NodeMotion &nodes) noexcept {
  const auto height = [&](const Section &section) { return grip(nodes, section).from_tip.dot(probe_.shaft); };
  if (fresh_) {
    fresh_ = false;
    // From the entry down to the tip; a blunt tip may still be outside the surface that it has ruptured.
    int near = guess_;
    for (std::size_t i = 0; i < kMaxSections; ++i) {
      const float up = static_cast<float>(i) * spacing_m_;
      const Eigen::Vector3f at = probe_.tip_m + up * probe_.shaft;
      const MaterialPoint point = find(nodes, at, near);
      if (point.inside()) {
        near = point.tetrahedron;
        sections_.insert(sections_.begin(), section_at(nodes, point, at));
      } else if (up > probe_.radius_m) {
        break;
      }
    }
    return;
  }
  while (!sections_.empty() && height(sections_.back()) < 0.0F) {
    sections_.pop_back();
  }
  if (tip_.inside() && sections_.size() < kMaxSections &&
      (sections_.empty() || height(sections_.back()) > spacing_m_)) {
    sections_.push_back(tip_section_);
  }
}

void CutContact::apply(const NodeMotion &nodes) noexcept {
  tip_force_ = 0.0F;
  shaft_force_.setZero();
  if (!active_) {
    return;
  }
  find_tip(nodes);
  const bool was_inside = !sections_.empty() || fresh_;
  update_constraints(nodes);
  if (sections_.empty()) {
    length_ = was_inside && tip_.inside() ? spacing_m_ : 0.0F;
  } else {
    length_ = std::max(grip(nodes, sections_.front()).from_tip.dot(probe_.shaft), 1e-6F);
  }

  const float dt = nodes.step_s;
  constexpr float kSweepFraction = 1.0F / static_cast<float>(kCutSweeps); // fraction of a step's friction per sweep
  const float max_friction_N_s = forces_.friction_N_per_m * spacing_m_ * dt * kSweepFraction;
  const float max_cutting_N_s = forces_.cutting_N * dt * kSweepFraction;
  const float max_sideways_N_s = forces_.sideways_N_per_m * spacing_m_ * dt;
  for (int sweep = 0; sweep < kCutSweeps; ++sweep) {
    for (Section &section : sections_) {
      const Grip held = grip(nodes, section);
      if (held.mobility <= 0.0F) {
        continue;
      }
      if (sweep == 0) {
        section.pushed_N_s.setZero();
      }
      // Sideways back to the constrained position; along the shaft as far as friction allows.
      const Eigen::Vector3f aside = held.from_tip - held.from_tip.dot(probe_.shaft) * probe_.shaft - section.offset;
      Eigen::Vector3f pushed = section.pushed_N_s - aside / (held.mobility * dt);
      const bool cuts = pushed.norm() > max_sideways_N_s;
      if (cuts) {
        pushed *= max_sideways_N_s / pushed.norm();
      }
      const Eigen::Vector3f back = pushed - section.pushed_N_s;
      section.pushed_N_s = pushed;
      if (cuts && sweep == kCutSweeps - 1) {
        section.offset += aside + held.mobility * dt * back;
      }
      const float rub = std::clamp(-held.slip.dot(probe_.shaft) / held.mobility, -max_friction_N_s, max_friction_N_s);
      const Eigen::Vector3f impulse = rub * probe_.shaft + back;
      push(nodes, section, impulse);
      shaft_force_ += impulse / dt;
    }
    // The tip pushes and never pulls.
    if (tip_.inside() && max_cutting_N_s > 0.0F) {
      const Grip held = grip(nodes, tip_section_);
      const float along = held.slip.dot(probe_.shaft);
      if (held.mobility > 0.0F && along > 0.0F) {
        const float pushed = std::min(along / held.mobility, max_cutting_N_s);
        push(nodes, tip_section_, -pushed * probe_.shaft);
        tip_force_ += pushed / dt;
      }
    }
  }
}

} // namespace bregma::tissue
