#include "algorithms/intensity/nonrigid_image.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <memory>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "algorithms/intensity/histogram_measure.hpp"
#include "algorithms/intensity/resolution.hpp"

namespace bregma::intensity {

namespace {

using Eigen::Matrix3f;
using Eigen::Matrix4d;
using Eigen::Vector3d;
using Eigen::Vector3f;
using Eigen::VectorXd;

constexpr double kCoarseLevel_mm = 8.0;
constexpr double kMiddleLevel_mm = 4.0;
constexpr int kCoarseLevelBins = 32;
constexpr double kFirstMove_mm = 1.0; // largest displacement of a node in the first step of a level
constexpr double kEnd_mm = 0.02;      // steps that move no node by more end a level
constexpr double kEndGain = 1e-6;     // so do gains below this, twice in a row

// Similarity of two images under the field, less the penalty, at one level.
class DeformedSimilarity {
public:
  DeformedSimilarity(const Volume &reference, const Volume &floating, const Matrix4d &T_floating_reference,
                     BSplineField &field, const NonrigidImageOptions &options, const MeasureOptions &of_measure,
                     parallel::Team &team)
      : measure_(make_histogram_measure(options.measure, reference, floating, of_measure, team)),
        sampler_(measure_->sampler()), T_(T_floating_reference), field_(field), bending_(options.bending), team_(team) {
    to_index_ = reference.axes().inverse().cast<float>();
    // Force on a displacement, mm in the reference's frame, from one on an index of the floating image.
    to_force_ = (floating.axes().inverse() * T_.topLeftCorner<3, 3>()).transpose().cast<float>();
    const Eigen::Matrix4f to_field =
        (field.grid().T_image_index.inverse() * reference.T_image_index).cast<float>(); // its grid is another level's
    for (std::size_t i = 0; i < sampler_.size(); ++i) {
      at_.push_back(field.weights_at((to_field * place(i).homogeneous()).head<3>()));
    }
    for (std::vector<float> &list : forces_) {
      list.resize(sampler_.padded());
    }
    parts_.assign(sampler_.parts().size(), std::vector<float>(field.coefficients().size()));
    (void)sampler_.moved();
  }

  // At the coefficients; NaN without overlap.
  double operator()(const VectorXd &coefficients, VectorXd &gradient) {
    ++evaluations_;
    for (std::size_t i = 0; i < field_.coefficients().size(); ++i) {
      field_.coefficients()[i] = static_cast<float>(coefficients[static_cast<Eigen::Index>(i)]);
    }
    move_samples();
    similarity_ = measure_->value_and_forces(T_, {forces_[0].data(), forces_[1].data(), forces_[2].data()});
    collect_forces();
    gradient.setZero(coefficients.size());
    for (const std::vector<float> &part : parts_) {
      gradient += Eigen::Map<const Eigen::VectorXf>(part.data(), gradient.size()).cast<double>();
    }
    bending_energy_ = field_.bending(-bending_, {gradient.data(), static_cast<std::size_t>(gradient.size())});
    return similarity_ - bending_ * bending_energy_;
  }
  [[nodiscard]] double similarity() const { return similarity_; }
  [[nodiscard]] double bending() const { return bending_energy_; }
  [[nodiscard]] int evaluations() const { return evaluations_; }

private:
  [[nodiscard]] Vector3f place(std::size_t i) const {
    return {sampler_.coordinate(0)[i], sampler_.coordinate(1)[i], sampler_.coordinate(2)[i]};
  }
  template <class Body> void for_parts(const Body &body) {
    team_.run_parts(sampler_.parts().size(), [&](std::size_t p) {
      const PairSampler::Part &part = sampler_.parts()[p];
      body(p, part.first, part.first + part.samples);
    });
  }
  void move_samples() {
    std::array<std::vector<float>, 3> &moved = sampler_.moved();
    for_parts([&](std::size_t, std::size_t first, std::size_t end) {
      for (std::size_t i = first; i < end; ++i) {
        const Vector3f index = place(i) + to_index_ * field_.displacement_mm(at_[i]);
        for (std::size_t d = 0; d < 3; ++d) {
          moved[d][i] = index[static_cast<Eigen::Index>(d)];
        }
      }
    });
  }
  void collect_forces() {
    for_parts([&](std::size_t p, std::size_t first, std::size_t end) {
      std::fill(parts_[p].begin(), parts_[p].end(), 0.0F);
      for (std::size_t i = first; i < end; ++i) {
        const Vector3f force(forces_[0][i], forces_[1][i], forces_[2][i]);
        if (force.squaredNorm() > 0.0F) { // background has none
          field_.add_force(at_[i], to_force_ * force, parts_[p]);
        }
      }
    });
  }

  std::unique_ptr<HistogramMeasure> measure_;
  PairSampler &sampler_;
  Matrix4d T_;
  BSplineField &field_;
  double bending_;
  parallel::Team &team_;
  Matrix3f to_index_, to_force_;
  std::vector<SplineWeights> at_;
  std::array<std::vector<float>, 3> forces_;
  std::vector<std::vector<float>> parts_; // of the gradient
  double similarity_ = 0.0, bending_energy_ = 0.0;
  int evaluations_ = 0;
};

double largest_move(const VectorXd &step) { return step.cwiseAbs().maxCoeff(); }

// The direction of L-BFGS from the last steps and changes of the gradient [Nocedal 1980], for a maximum.
class LimitedMemory {
public:
  [[nodiscard]] bool empty() const { return pairs_.empty(); }
  void forget() { pairs_.clear(); }
  void take(const VectorXd &step, const VectorXd &change) { // change of the negative gradient
    constexpr std::size_t kPairs = 8;
    const double curvature = step.dot(change);
    if (curvature > 1e-10 * step.norm() * change.norm()) {
      pairs_.push_back({step, change, curvature});
      if (pairs_.size() > kPairs) {
        pairs_.pop_front();
      }
    }
  }
  [[nodiscard]] VectorXd direction(VectorXd gradient) const {
    std::vector<double> alpha(pairs_.size());
    for (std::size_t i = pairs_.size(); i-- > 0;) {
      alpha[i] = pairs_[i].step.dot(gradient) / pairs_[i].curvature;
      gradient -= alpha[i] * pairs_[i].change;
    }
    gradient *= pairs_.back().curvature / pairs_.back().change.squaredNorm();
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const double beta = pairs_[i].change.dot(gradient) / pairs_[i].curvature;
      gradient += (alpha[i] - beta) * pairs_[i].step;
    }
    return gradient;
  }

private:
  struct Pair {
    VectorXd step, change;
    double curvature;
  };
  std::deque<Pair> pairs_;
};

// Leaves the field at the best coefficients. False: nothing to compare at the start.
bool maximise(DeformedSimilarity &similarity, BSplineField &field, int max_iterations) {
  VectorXd at = Eigen::Map<const Eigen::VectorXf>(field.coefficients().data(),
                                                  static_cast<Eigen::Index>(field.coefficients().size()))
                    .cast<double>();
  VectorXd gradient;
  double value = similarity(at, gradient);
  if (!std::isfinite(value)) {
    return false;
  }
  LimitedMemory memory;
  VectorXd next_gradient;
  int small_gains = 0;
  for (int iteration = 0; iteration < max_iterations && gradient.norm() > 0.0; ++iteration) {
    const bool steepest = memory.empty();
    VectorXd step =
        steepest ? VectorXd(gradient * (kFirstMove_mm / largest_move(gradient))) : memory.direction(gradient);
    const double longest = 4.0 * kFirstMove_mm;
    if (largest_move(step) > longest) {
      step *= longest / largest_move(step);
    }
    double next = std::numeric_limits<double>::quiet_NaN();
    constexpr int kMaxHalvings = 6;
    for (int n = 0; n < kMaxHalvings && largest_move(step) > 0.1 * kEnd_mm; ++n) {
      next = similarity(at + step, next_gradient);
      if (next > value + 1e-4 * step.dot(gradient)) { // [Armijo]
        break;
      }
      next = std::numeric_limits<double>::quiet_NaN();
      step *= 0.4;
    }
    if (!std::isfinite(next)) {
      if (steepest) {
        break;
      }
      memory.forget();
      continue;
    }
    memory.take(step, gradient - next_gradient);
    small_gains = next - value < kEndGain ? small_gains + 1 : 0;
    at += step;
    value = next;
    gradient = next_gradient;
    if (small_gains >= 2 || largest_move(step) < kEnd_mm) {
      break;
    }
  }
  (void)similarity(at, gradient); // the last evaluation may have been a step that was taken back
  return true;
}

std::string text_of(const char *format, double value) {
  std::array<char, 160> out{};
  std::snprintf(out.data(), out.size(), format, value);
  return out.data();
}

double largest_displacement(const BSplineField &field) {
  double largest = 0.0;
  const image::Grid<3> &grid = field.grid();
  for (int k = 0; k < grid.size[2]; ++k) {
    for (int j = 0; j < grid.size[1]; ++j) {
      for (int i = 0; i < grid.size[0]; ++i) {
        const Vector3f at(static_cast<float>(i), static_cast<float>(j), static_cast<float>(k));
        largest = std::max(largest, static_cast<double>(field.displacement_mm(field.weights_at(at)).squaredNorm()));
      }
    }
  }
  return std::sqrt(largest);
}

struct NonrigidLevel {
  Volume reference, floating;
  double refine;       // cells are this many times as large as the finest ones
  std::size_t samples; // 0: all
  int bins;
  const char *name;
};

} // namespace

NonrigidImageResult register_nonrigid(const Volume &reference, const Volume &floating,
                                      const ReferenceFromFloating &T_reference_floating,
                                      const NonrigidImageOptions &options, parallel::Team &team) {
  const Matrix4d T = T_reference_floating.inverse().matrix();
  std::vector<NonrigidLevel> levels(3);
  levels[2] = {shrunk(reference, options.finest_mm, team),
               shrunk(floating, options.finest_mm, team),
               1.0,
               options.max_samples,
               options.measure_options.bins,
               "deforming at the finest level"};
  const int few = std::min(options.measure_options.bins, kCoarseLevelBins);
  levels[1] = {shrunk(levels[2].reference, kMiddleLevel_mm, team),
               shrunk(levels[2].floating, kMiddleLevel_mm, team),
               1.0,
               options.max_samples,
               few,
               "deforming at 4 mm"};
  levels[0] = {shrunk(levels[1].reference, kCoarseLevel_mm, team),
               shrunk(levels[1].floating, kCoarseLevel_mm, team),
               2.0,
               0,
               few,
               "deforming at 8 mm"};
  // The lattice covers the finest grid; coarser grids cover nearly the same box.
  BSplineField coarse(levels[2].reference, 2.0 * options.grid_mm);
  NonrigidImageResult out{false, {}, coarse, {}, 0.0, 0.0, 0.0, 0.0, 0};
  bool is_coarse = true;
  for (std::size_t n = 0; n < levels.size(); ++n) {
    const NonrigidLevel &level = levels[n];
    if (options.progress && !options.progress(static_cast<double>(n) / 3.0, level.name)) {
      out.reason = "stopped";
      return out;
    }
    if (is_coarse && level.refine < 2.0) {
      out.field = out.field.refined();
      is_coarse = false;
    }
    MeasureOptions of_measure = options.measure_options;
    of_measure.interpolation = Interpolation::kParzen;
    of_measure.bins = level.bins;
    of_measure.max_samples = level.samples;
    of_measure.seed = options.seed;
    DeformedSimilarity similarity(level.reference, level.floating, T, out.field, options, of_measure, team);
    if (n == 2) { // what the pose alone has
      BSplineField found = out.field;
      VectorXd none = VectorXd::Zero(static_cast<Eigen::Index>(found.coefficients().size()));
      VectorXd ignored;
      (void)similarity(none, ignored);
      out.similarity_before = similarity.similarity();
      out.field = std::move(found);
    }
    if (!maximise(similarity, out.field, options.max_iterations)) {
      out.reason = "the images do not overlap";
      return out;
    }
    out.evaluations += similarity.evaluations();
    out.similarity = similarity.similarity();
    out.bending_per_mm2 = similarity.bending();
  }
  out.jacobian = out.field.jacobian(team);
  out.largest_mm = largest_displacement(out.field);
  if (!(out.jacobian.smallest > 0.0)) {
    out.reason = "the deformation folds (smallest Jacobian " + text_of("%.2f", out.jacobian.smallest) +
                 "): a larger penalty or coarser grid is needed";
  } else if (!(out.similarity > out.similarity_before)) {
    out.reason = "the deformation does not make the images more similar";
  } else {
    out.found = true;
  }
  return out;
}

} // namespace bregma::intensity
