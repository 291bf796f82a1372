#include "algorithms/tissue_plane/plane_probe.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "algorithms/tissue_plane/plane_mesher.hpp"

namespace bregma::tissue_plane {
namespace {

using Eigen::Vector2d;

constexpr double kOnAxis_mm = 1e-6;
// Move of the probe per step as a fraction of the smallest height, so that nodes can follow.
constexpr double kPace = 0.02;
constexpr int kProjections =
    4; // iterations of the projection onto the ellipse: within 1e-6 mm for the moves of one step

} // namespace

PlaneProbe::PlaneProbe(PlaneSolver &solver, const PlaneProbeSettings &settings) : solver_(solver), settings_(settings) {
  const auto refuse = [](const char *what, double value, const char *need) {
    throw std::invalid_argument("plane probe: " + std::string(what) + " = " + std::to_string(value) + ", must be " +
                                need);
  };
  if (!(settings.width_mm > 0.0)) {
    refuse("width_mm", settings.width_mm, "positive");
  }
  if (!(settings.nose_mm > 0.0)) {
    refuse("nose_mm", settings.nose_mm, "positive");
  }
  if (!(settings.step_mm > 0.0)) {
    refuse("step_mm", settings.step_mm, "positive");
  }
  if (!(settings.friction >= 0.0)) {
    refuse("friction", settings.friction, "at least 0");
  }
  if (!(settings.cutting_fraction >= 0.0 && settings.cutting_fraction <= 1.0)) {
    refuse("cutting_fraction", settings.cutting_fraction, "from 0 to 1");
  }
  find_path();
  for (const Eigen::Vector2i &edge : boundary_of(solver.mesh())) {
    candidates_.push_back({.node = edge[0]});
  }
  candidates_.reserve(candidates_.size() + 2 * path_.size());
  tip_mm_ = goal_mm_ = entry_mm();
  half_mm_ = narrowest_mm_ = 0.5 * settings.width_mm;
  pace_mm_ = kPace * quality_of(solver.mesh()).smallest_height_mm;
  solver_.set_contact(this);
}

PlaneProbe::~PlaneProbe() { solver_.set_contact(nullptr); }

void PlaneProbe::find_path() {
  const PlaneMesh &mesh = solver_.mesh();
  const auto at = [&](int n) -> const Vector2d & { return mesh.nodes_mm[static_cast<std::size_t>(n)]; };
  const auto on_axis = [&](int n) { return std::abs(at(n).y() - settings_.axis_y_mm) < kOnAxis_mm; };
  std::vector<std::vector<int>> below(mesh.nodes_mm.size());
  std::vector<int> next(mesh.nodes_mm.size(), -1); // along the axis
  for (std::size_t e = 0; e < mesh.triangles.size(); ++e) {
    const Eigen::Vector3i &t = mesh.triangles[e];
    const double middle_y = (at(t[0]).y() + at(t[1]).y() + at(t[2]).y()) / 3.0;
    for (int k = 0; k < 3; ++k) {
      const int a = t[k];
      const int b = t[(k + 1) % 3];
      if (on_axis(a) && middle_y < settings_.axis_y_mm) {
        below[static_cast<std::size_t>(a)].push_back(static_cast<int>(e));
      }
      if (on_axis(a) && on_axis(b) && at(a).x() < at(b).x()) {
        next[static_cast<std::size_t>(a)] = b;
      }
    }
  }
  int first = -1;
  for (int n = 0; n < static_cast<int>(next.size()); ++n) {
    if (next[static_cast<std::size_t>(n)] >= 0 && (first < 0 || at(n).x() < at(first).x())) {
      first = n;
    }
  }
  for (int n = first; n >= 0; n = next[static_cast<std::size_t>(n)]) {
    path_.push_back(n);
    below_.push_back(below[static_cast<std::size_t>(n)]);
  }
  if (path_.size() < 3) {
    throw std::invalid_argument("plane probe: the mesh has no edges along y = " + std::to_string(settings_.axis_y_mm) +
                                " mm");
  }
}

double PlaneProbe::entry_mm() const { return solver_.mesh().nodes_mm[static_cast<std::size_t>(path_.front())].x(); }

ProbeReading PlaneProbe::move_to(double tip_mm) {
  if (phase_ == ProbePhase::kRupture && tip_mm > tip_mm_) {
    open();
  }
  while (goal_mm_ < tip_mm) {
    goal_mm_ = std::min(goal_mm_ + settings_.step_mm, tip_mm);
    settle(settings_.relax_between);
    if (phase_ == ProbePhase::kPenetration) {
      cut_reached_nodes();
    } else {
      phase_ = goal_mm_ > entry_mm() ? ProbePhase::kIndentation : ProbePhase::kApart;
      if (at_its_limit()) {
        settle(settings_.relax_at_end);
      }
      if (at_its_limit()) {
        phase_ = ProbePhase::kRupture;
        break;
      }
    }
  }
  settle(settings_.relax_at_end);
  return reading();
}

ProbeReading PlaneProbe::rupture() {
  if (phase_ != ProbePhase::kPenetration && !ruptured()) {
    phase_ = ProbePhase::kRupture;
    cutting_N_m_ = settings_.cutting_fraction * reading().tip_N_m;
    blade_ = true;
    cut_next();
    settle(settings_.relax_between);
    cut_reached_nodes();
    settle(settings_.relax_at_end);
  }
  return reading();
}

ProbeReading PlaneProbe::open() {
  if (phase_ != ProbePhase::kPenetration) {
    rupture();
    phase_ = ProbePhase::kPenetration;
    blade_ = false;
    settle(settings_.relax_between);
    cut_reached_nodes();
    settle(settings_.relax_at_end);
  }
  return reading();
}

void PlaneProbe::settle(const PlaneRelaxationOptions &limits) {
  rest_ = solver_.relax(limits);
  // A node that has slid gets its new position as anchor.
  for (Candidate &c : candidates_) {
    c.anchored = c.touching != Part::kNone;
    c.anchor_mm = solver_.position_mm(c.node) - Vector2d(tip_mm_, settings_.axis_y_mm);
  }
}

bool PlaneProbe::at_its_limit() const {
  if (reading().tip_N_m >= settings_.rupture_N_m) {
    return true;
  }
  return std::isfinite(settings_.rupture_Pa) &&
         solver_.nodal_stress()[static_cast<std::size_t>(path_.front())].von_mises() >= settings_.rupture_Pa;
}

void PlaneProbe::cut_next() {
  const int node = path_[cut_];
  solver_.set_force(node, Vector2d::Zero());
  const int lower = solver_.split(node, below_[cut_]);
  candidate(node).side = 1;
  candidate(lower).side = -1;
  ++cut_;
  solver_.set_force(path_[cut_], {cutting_N_m_, 0.0});
}

void PlaneProbe::cut_reached_nodes() {
  // The last node of the path is on the far side of the section and is not cut.
  while (cut_ + 2 < path_.size() && solver_.position_mm(path_[cut_]).x() <= tip_mm_) {
    cut_next();
    settle(settings_.relax_between);
  }
}

PlaneProbe::Candidate &PlaneProbe::candidate(int node) {
  const auto it =
      std::find_if(candidates_.begin(), candidates_.end(), [&](const Candidate &c) { return c.node == node; });
  return it != candidates_.end() ? *it : candidates_.emplace_back(Candidate{.node = node});
}

// from_tip_mm: x along the probe, 0 at the tip; y from the axis. The surface is moved out along the shortest path, to
// the precision of the ellipse's projection. Lips are moved to their own side at the solver's pace: moved along the
// axis they would accumulate in front of a blunt end.
PlaneProbe::Part PlaneProbe::push_out(Vector2d &from_tip_mm, const Candidate &c) const {
  Vector2d &p = from_tip_mm;
  if (p.x() >= 0.0) {
    return Part::kNone;
  }
  const double nose = settings_.nose_mm;
  const double into_nose = std::max((p.x() + nose) / nose, 0.0); // 0 along the sides, 1 at the tip
  const double side_mm = half_mm_ * std::sqrt(1.0 - into_nose * into_nose);
  if (c.side != 0) {
    const double out_mm = std::min(side_mm, c.open_mm);
    if (c.side * p.y() >= out_mm) {
      return Part::kNone;
    }
    p.y() = c.side * out_mm;
    return Part::kSide;
  }
  if (std::abs(p.y()) >= side_mm) {
    return Part::kNone;
  }
  if (into_nose == 0.0) {
    const double end_x = nose * (std::sqrt(1.0 - std::pow(p.y() / half_mm_, 2)) - 1.0);
    if (end_x - p.x() < half_mm_ - std::abs(p.y())) {
      p.x() = end_x;
      return Part::kEnd;
    }
    p.y() = p.y() < 0.0 ? -half_mm_ : half_mm_;
    return Part::kSide;
  }
  for (int k = 0; k < kProjections; ++k) {
    const double level = std::pow((p.x() + nose) / nose, 2) + std::pow(p.y() / half_mm_, 2) - 1.0;
    const Vector2d slope(2.0 * (p.x() + nose) / (nose * nose), 2.0 * p.y() / (half_mm_ * half_mm_));
    p -= level / slope.squaredNorm() * slope;
  }
  return Part::kEnd;
}

void PlaneProbe::keep_out(Candidate &c, Vector2d &position_m) {
  const Vector2d tip(tip_mm_, settings_.axis_y_mm);
  const Vector2d wanted = 1e3 * position_m - tip;
  Vector2d p = wanted;
  if (c.side * p.y() < 0.0) {
    p.y() = 0.0;
  }
  if (!ruptured() && c.node == path_.front()) {
    c.touching = p.x() < 0.0 ? Part::kEnd : Part::kNone;
    position_m = p.x() < 0.0 ? Vector2d(1e-3 * tip) : position_m;
    return;
  }
  c.touching = blade_ ? Part::kNone : push_out(p, c);
  if (c.touching == Part::kNone) {
    c.anchored = false;
  } else if (!c.anchored) {
    c.anchored = true;
    c.anchor_mm = p;
  } else {
    const Vector2d back = c.anchor_mm - p;
    const double allowed = settings_.friction * (p - wanted).norm();
    p += std::min(1.0, allowed / std::max(back.norm(), 1e-12)) * back;
    (void)push_out(p, c); // along the ellipse, not normal to it
  }
  if (p != wanted) {
    position_m = 1e-3 * (p + tip);
  }
}

void PlaneProbe::project(std::span<Vector2d> next_m) {
  tip_mm_ += std::clamp(goal_mm_ - tip_mm_, -pace_mm_, pace_mm_);
  narrowest_mm_ = half_mm_;
  for (Candidate &c : candidates_) {
    if (c.side != 0 && !blade_) {
      c.open_mm = std::min(c.open_mm + pace_mm_, half_mm_);
      narrowest_mm_ = std::min(narrowest_mm_, c.open_mm);
    }
    keep_out(c, next_m[static_cast<std::size_t>(c.node)]);
  }
}

ProbeReading PlaneProbe::reading() const {
  ProbeReading out;
  out.phase = phase_;
  out.tip_mm = tip_mm_;
  out.rest = rest_;
  for (const Candidate &c : candidates_) {
    const Vector2d force = solver_.reaction(c.node);
    if (c.touching == Part::kEnd) {
      out.tip_N_m += force.x();
    } else if (c.touching == Part::kSide) {
      out.friction_N_m += force.x();
      const bool above = solver_.position_mm(c.node).y() > settings_.axis_y_mm;
      (above ? out.plus_N_m : out.minus_N_m) += above ? force.y() : -force.y();
    }
  }
  if (ruptured()) {
    out.tip_N_m += cutting_N_m_;
    const auto &nodes = solver_.mesh().nodes_mm;
    out.cut_mm = nodes[static_cast<std::size_t>(path_[cut_])].x() - entry_mm();
  }
  return out;
}

} // namespace bregma::tissue_plane
