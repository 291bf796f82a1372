#include "tests/support/tissue_insertions.hpp"

#include <cmath>
#include <cstdio>
#include <limits>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace bregma::test {
namespace {

using Eigen::Vector3d;
using tissue::BrainModel;
using tissue::BrainState;
using tissue::ModelReason;
using tissue::ModelStatus;

constexpr double kBeyondHertz = 3.0;
constexpr std::size_t kMaxExamples = 5;
constexpr double kAtRest_mm = 0.25; // residual displacement after kCalm_s of damping
constexpr double kCalm_s = 2.0;

class Operator {
public:
  Operator(BrainModel &model, const InsertionSite &site, const PhysicalBounds &bounds, std::uint32_t seed)
      : model_(model), bounds_(bounds), seed_(seed), random_(seed) {
    const Vector3d side = site.outward.unitOrthogonal();
    const Vector3d other = site.outward.cross(side);
    const double aside = site.aside_mm * std::sqrt(uniform(0.0, 1.0));
    const double around = uniform(0.0, 6.2832);
    entry_mm_ = site.entry_mm + aside * (std::cos(around) * side + std::sin(around) * other);
    shaft_ = (site.outward + uniform(-0.4, 0.4) * side + uniform(-0.4, 0.4) * other).normalized();
    deepest_mm_ = uniform(2.0, site.deepest_mm);
  }

  InsertionFindings operate() {
    height_mm_ = kStart_mm;
    const int moves = static_cast<int>(uniform(1.0, 5.0));
    for (int i = 0; i < moves; ++i) {
      go_to(-deepest_mm_ * uniform(0.2, 1.0));
      if (chance(0.4)) {
        pause(uniform(0.05, 0.5));
      }
      if (chance(0.4)) {
        go_to(height_mm_ + uniform(1.0, 15.0)); // a retreat
      }
      if (chance(0.3)) {
        lose_sight(uniform(0.02, 1.5));
      }
      if (chance(0.2)) {
        jump();
      }
      if (chance(0.2)) {
        talk_nonsense();
      }
    }
    go_to(kStart_mm);
    height_mm_ = 100.0; // away
    pause(kCalm_s);
    look_at_rest();
    return findings_;
  }

private:
  static constexpr double kStart_mm = 15.0;

  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  Vector3d anywhere() { // a direction
    const double x = uniform(-1.0, 1.0);
    const double y = uniform(-1.0, 1.0);
    return Vector3d(x, y, uniform(-1.0, 1.0)).normalized();
  }
  bool chance(double share) { return uniform(0.0, 1.0) < share; }

  [[nodiscard]] tissue::ProbeObservation seen() const {
    return {.seen = true, .pose = {entry_mm_ + height_mm_ * shaft_, shaft_}, .force_N = {}};
  }

  void go_to(double height_mm) {
    const double speed_mm_s = std::exp(uniform(std::log(2.0), std::log(50.0)));
    const Vector3d turning = chance(0.3) ? Vector3d(uniform(0.0, 0.2) * anywhere()) : Vector3d(Vector3d::Zero()); // 1/s
    while (std::abs(height_mm_ - height_mm) > 1e-9) {
      const double max_mm = speed_mm_s * kUpdate_s;
      height_mm_ += std::clamp(height_mm - height_mm_, -max_mm, max_mm);
      shaft_ = (shaft_ + kUpdate_s * turning.cross(shaft_)).normalized();
      update(seen());
    }
  }

  void pause(double time_s) {
    for (double t = 0.0; t < time_s; t += kUpdate_s) {
      update(seen());
    }
  }

  // The operator continues meanwhile.
  void lose_sight(double time_s) {
    for (double t = 0.0; t < time_s; t += kUpdate_s) {
      update({});
    }
    height_mm_ = std::max(-deepest_mm_, height_mm_ + uniform(-8.0, 8.0));
    update(seen());
  }

  // For a few samples the tracker mistakes another object for the probe.
  void jump() {
    tissue::ProbeObservation wrong = seen();
    wrong.pose.tip_mm += uniform(5.0, 60.0) * anywhere();
    if (chance(0.5)) {
      wrong.pose.shaft = anywhere();
    }
    const int samples = static_cast<int>(uniform(1.0, 6.0));
    for (int i = 0; i < samples; ++i) {
      update(wrong);
    }
    update(seen());
  }

  void talk_nonsense() {
    tissue::ProbeObservation wrong = seen();
    switch (static_cast<int>(uniform(0.0, 4.0))) {
    case 0:
      wrong.pose.tip_mm.y() = std::numeric_limits<double>::quiet_NaN();
      break;
    case 1:
      wrong.pose.shaft.setZero();
      break;
    case 2:
      wrong.pose.shaft.x() = std::numeric_limits<double>::infinity();
      break;
    default:
      wrong.force_N = std::numeric_limits<double>::quiet_NaN();
      break;
    }
    update(wrong);
  }

  void update(const tissue::ProbeObservation &probe) {
    const BrainState &state = model_.update(probe, kUpdate_s, kManySteps);
    ++findings_.updates;
    const bool valid = state.status == ModelStatus::kValid;
    findings_.valid += valid ? 1 : 0;
    findings_.invalid += state.status == ModelStatus::kInvalid ? 1 : 0;
    if (valid != (state.reason == ModelReason::kNone)) {
      note(findings_.contradictions, "status and reason do not agree", 0.0);
    }
    double largest_mm = 0.0;
    for (int i = 0; i < model_.solver().nodes(); ++i) {
      const double moved_mm = model_.solver().displacement_mm(i).norm();
      largest_mm = moved_mm <= largest_mm ? largest_mm : moved_mm; // keeps NaN
    }
    bool finite = std::isfinite(largest_mm) && std::isfinite(state.tip_force_N + state.shaft_force_N + state.depth_mm +
                                                             state.stiffness_scale + state.behind_s);
    for (const tissue::PointPrediction &point : model_.points()) {
      finite = finite && point.displacement_mm.allFinite() && std::isfinite(point.von_mises_Pa);
    }
    if (!finite) {
      note(findings_.not_finite, "not a number", largest_mm);
    }
    if (!valid) {
      return;
    }
    const tissue::Energies energies = model_.solver().energies();
    const double energy_J = energies.elastic_J + energies.kinetic_J;
    findings_.largest_mm = std::max(findings_.largest_mm, largest_mm);
    findings_.largest_J = std::max(findings_.largest_J, energy_J);
    if (largest_mm > bounds_.displacement_mm) {
      note(findings_.beyond_bounds, "valid with a displacement (mm) of", largest_mm);
    } else if (energy_J > bounds_.energy_J) {
      note(findings_.beyond_bounds, "valid with an energy (mJ) of", 1e3 * energy_J);
    }
    if (const int turned = inverted(); turned > 0) {
      note(findings_.inverted, "valid with inverted tetrahedra:", turned);
    }
  }

  [[nodiscard]] int inverted() const {
    int out = 0;
    for (int e = 0; e < model_.solver().elements(); ++e) {
      out += model_.solver().deformation_gradient(e).determinant() > 0.0 ? 0 : 1;
    }
    return out;
  }

  void look_at_rest() {
    double largest_mm = 0.0;
    for (int i = 0; i < model_.solver().nodes(); ++i) {
      largest_mm = std::max(largest_mm, model_.solver().displacement_mm(i).norm());
    }
    if (largest_mm > kAtRest_mm || model_.state().phase != tissue::Phase::kOutside) {
      note(findings_.not_at_rest, "probe away, but displaced (mm) by", largest_mm);
    }
  }

  void note(int &counter, const char *what, double value) {
    ++counter;
    if (findings_.examples.size() < kMaxExamples) {
      char text[160];
      std::snprintf(text, sizeof text, "seed %u, update %d, %s, %.1f mm above the entry: %s %.3g", seed_,
                    findings_.updates, std::string(name_of(model_.state().phase)).c_str(), height_mm_, what, value);
      findings_.examples.emplace_back(text);
    }
  }

  BrainModel &model_;
  PhysicalBounds bounds_;
  std::uint32_t seed_;
  std::mt19937 random_;
  Vector3d entry_mm_, shaft_;
  double deepest_mm_ = 0.0, height_mm_ = 0.0;
  InsertionFindings findings_;
};

} // namespace

PhysicalBounds physical_bounds(const tissue::BrainModelOptions &options) {
  const double nu = options.material.poisson;
  const double radius_m = 1e-3 * options.probe.radius_mm;
  const double force_N = options.insertion.rupture_force_N;
  const double indentation_m =
      std::pow(0.75 * force_N * (1.0 - nu * nu) / (options.material.young_Pa * std::sqrt(radius_m)), 2.0 / 3.0);
  return {.displacement_mm = kBeyondHertz * 1e3 * indentation_m, .energy_J = kBeyondHertz * force_N * indentation_m};
}

void InsertionFindings::add(const InsertionFindings &other) {
  updates += other.updates;
  valid += other.valid;
  invalid += other.invalid;
  not_finite += other.not_finite;
  inverted += other.inverted;
  beyond_bounds += other.beyond_bounds;
  contradictions += other.contradictions;
  not_at_rest += other.not_at_rest;
  largest_mm = std::max(largest_mm, other.largest_mm);
  largest_J = std::max(largest_J, other.largest_J);
  for (const std::string &example : other.examples) {
    if (examples.size() < kMaxExamples) {
      examples.push_back(example);
    }
  }
}

InsertionFindings insert_at_random(BrainModel &model, const InsertionSite &site, const PhysicalBounds &bounds,
                                   std::uint32_t seed) {
  return Operator(model, site, bounds, seed).operate();
}

} // namespace bregma::test
