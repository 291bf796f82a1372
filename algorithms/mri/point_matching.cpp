#include "algorithms/mri/point_matching.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "algorithms/mri/lattice.hpp"
#include "algorithms/mri/smooth_map.hpp"
#include "algorithms/registration/clouds/cpd.hpp"
#include "algorithms/registration/points/paired_points.hpp"

namespace bregma::mri {

namespace {

using Eigen::Index;
using Eigen::Vector3d;
using geometry::Matrix3d;
using geometry::Points3;
using Pose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

constexpr Index kMinMatched = kFewestMatched;
constexpr double kIsolated = 1.6;     // of the spacing, to the nearest neighbour
constexpr double kRepeated_mm = 0.01; // one point, written twice
constexpr double kFirstGate = 0.35;   // of the spacing: pairs of a map of the whole
constexpr int kFinalRounds = 4;
constexpr double kResidualShare = 0.13;
constexpr double kDoubled = 0.45;      // of the spacing, between two points of one set
constexpr double kMinAmbiguous = 3.0;  // pairs
constexpr double kSamePlacement = 0.9; // of the pairs

Points3 moved(const Pose &pose, const Points3 &p) {
  return (pose.rotation_matrix() * p).colwise() + pose.translation();
}

struct Nearest {
  Index index = -1;
  double distance_mm = std::numeric_limits<double>::infinity();
};
struct Neighbourhoods {
  std::vector<Nearest> of_reference, of_imaged;
};
Neighbourhoods nearest(const Points3 &reference, const Points3 &imaged) {
  Neighbourhoods out;
  out.of_reference.resize(static_cast<std::size_t>(reference.cols()));
  out.of_imaged.resize(static_cast<std::size_t>(imaged.cols()));
  for (Index i = 0; i < reference.cols(); ++i) {
    for (Index j = 0; j < imaged.cols(); ++j) {
      const double d = (reference.col(i) - imaged.col(j)).norm();
      if (auto &r = out.of_reference[static_cast<std::size_t>(i)]; d < r.distance_mm) {
        r = {j, d};
      }
      if (auto &m = out.of_imaged[static_cast<std::size_t>(j)]; d < m.distance_mm) {
        m = {i, d};
      }
    }
  }
  return out;
}

struct Placement {
  std::vector<MatchedPair> pairs;
  Points3 predicted; // reference points in the imaged frame, with the smooth distortion
  double score = 0.0;
};

Points3 select(const Points3 &points, bool reference, const std::vector<MatchedPair> &pairs) {
  Points3 out(3, static_cast<Index>(pairs.size()));
  for (Index i = 0; i < out.cols(); ++i) {
    const MatchedPair &pair = pairs[static_cast<std::size_t>(i)];
    out.col(i) = points.col(reference ? pair.reference : pair.imaged);
  }
  return out;
}

// One attempt to explain the imaged points from a start pose.
class Explanation {
public:
  Explanation(const Points3 &reference, const Points3 &imaged, double spacing_mm, const MatchOptions &options)
      : reference_(reference), imaged_(imaged), spacing_mm_(spacing_mm), options_(options) {}

  [[nodiscard]] Placement from(const Pose &start) const {
    Placement out;
    const Points3 placed = moved(start, reference_);
    out.predicted = placed;
    out.predicted = SoftSmoothMap(placed, imaged_, spacing_mm_).run(options_.max_degree);
    for (int round = 0; round < kFinalRounds; ++round) {
      out.pairs = mutual_pairs(out.predicted, kFirstGate * spacing_mm_);
      if (out.pairs.size() < kMinMatched) {
        return out;
      }
      out.predicted = smooth(placed, out.pairs, options_.max_degree);
    }
    for (MatchedPair &pair : out.pairs) {
      pair.residual_mm = (out.predicted.col(pair.reference) - imaged_.col(pair.imaged)).norm();
      out.score += std::max(0.0, 1.0 - std::pow(pair.residual_mm / (2.0 * limit()), 2));
    }
    return out;
  }

  [[nodiscard]] double limit() const {
    return options_.max_residual_mm > 0.0 ? options_.max_residual_mm : kResidualShare * spacing_mm_;
  }

private:
  [[nodiscard]] Points3 smooth(const Points3 &placed, const std::vector<MatchedPair> &pairs, int degree) const {
    return SmoothMap(select(placed, true, pairs), select(imaged_, false, pairs), degree)(placed);
  }

  [[nodiscard]] std::vector<MatchedPair> mutual_pairs(const Points3 &predicted, double gate_mm) const {
    const Neighbourhoods n = nearest(predicted, imaged_);
    std::vector<MatchedPair> out;
    for (Index i = 0; i < predicted.cols(); ++i) {
      const Nearest &r = n.of_reference[static_cast<std::size_t>(i)];
      if (r.distance_mm < gate_mm && n.of_imaged[static_cast<std::size_t>(r.index)].index == i) {
        out.push_back({i, r.index, r.distance_mm});
      }
    }
    return out;
  }

  const Points3 &reference_, &imaged_;
  double spacing_mm_;
  const MatchOptions &options_;
};

bool same_pairs(const std::vector<MatchedPair> &a, const std::vector<MatchedPair> &b) {
  std::size_t common = 0;
  auto at = b.begin();
  for (const MatchedPair &pair : a) { // both are sorted by reference
    while (at != b.end() && at->reference < pair.reference) {
      ++at;
    }
    common += at != b.end() && at->reference == pair.reference && at->imaged == pair.imaged ? 1 : 0;
  }
  return static_cast<double>(common) > kSamePlacement * static_cast<double>(std::max(a.size(), b.size()));
}

// Turns of the lattice into itself: rotations that permute its axes, without the identity.
std::vector<Matrix3d> lattice_turns(const Points3 &steps) {
  std::vector<Matrix3d> out;
  if (steps.cols() < 3) {
    return out;
  }
  // The nearest right-handed orthonormal axes to the steps.
  Matrix3d axes = steps.colwise().normalized();
  axes.col(1) = (axes.col(1) - axes.col(1).dot(axes.col(0)) * axes.col(0)).normalized();
  axes.col(2) = axes.col(0).cross(axes.col(1));
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Matrix3d turned;
      for (int axis = 0; axis < 3; ++axis) {
        turned.col(axis) = ((signs >> axis) & 1) != 0 ? Vector3d(-axes.col(order[static_cast<std::size_t>(axis)]))
                                                      : Vector3d(axes.col(order[static_cast<std::size_t>(axis)]));
      }
      const Matrix3d R = turned * axes.transpose();
      if (R.determinant() > 0.0 && R.trace() < 2.9) {
        out.push_back(R);
      }
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return out;
}

// The points that may have a partner. Left out: repeated ones, which would be the nearest of each other, and isolated
// ones.
std::vector<Index> usable_points(const Points3 &points, std::vector<UnmatchedPoint> &left_out) {
  std::vector<Index> single;
  for (Index i = 0; i < points.cols(); ++i) {
    const auto same = std::find_if(single.begin(), single.end(),
                                   [&](Index j) { return (points.col(i) - points.col(j)).norm() < kRepeated_mm; });
    if (same == single.end()) {
      single.push_back(i);
    } else {
      left_out.push_back({i, UnmatchedReason::kDoubled, (points.col(i) - points.col(*same)).norm()});
    }
  }
  std::vector<Index> kept;
  const std::vector<double> distances = nearest_distances(points(Eigen::all, single));
  const double spacing_mm = median(distances);
  for (std::size_t i = 0; i < distances.size(); ++i) {
    if (distances[i] > kIsolated * spacing_mm) {
      left_out.push_back({single[i], UnmatchedReason::kIsolated, distances[i]});
    } else {
      kept.push_back(single[i]);
    }
  }
  return kept;
}

std::optional<Pose> rigid_fit(const Points3 &reference, const Points3 &imaged, const std::vector<MatchedPair> &pairs) {
  std::vector<Vector3d> from, to;
  for (const MatchedPair &pair : pairs) {
    from.emplace_back(reference.col(pair.reference));
    to.emplace_back(imaged.col(pair.imaged));
  }
  return registration::fit_rigid(from, to);
}

class Matching {
public:
  Matching(const Points3 &reference, const Points3 &imaged, const MatchOptions &options)
      : options_(options), reference_(reference), imaged_(imaged), spacing_mm_(median(nearest_distances(imaged))),
        growth_(reference_, imaged_, spacing_mm_, options_) {}

  MatchResult run() {
    registration::CpdOptions cpd;
    const auto rigid = registration::register_cpd<3>(reference_, imaged_, cpd);
    if (!rigid.has_estimate()) {
      result_.outcome = MatchOutcome::kNoMatch;
      return result_;
    }
    best_ = growth_.from(Pose(Matrix3d(rigid.rotation), Vector3d(rigid.transform.translation)));
    best_pose_ = rigid_fit(reference_, imaged_, best_.pairs);
    explore();
    finish();
    return result_;
  }

private:
  // Neighbouring and turned placements; a better one becomes the best, and its own neighbours are tried.
  void explore() {
    const Points3 steps = lattice_steps(imaged_).steps_mm;
    const Vector3d centre = imaged_.rowwise().mean();
    for (bool again = true; again && best_pose_;) {
      again = false;
      std::vector<Pose> starts;
      for (Index i = 0; i < steps.cols(); ++i) {
        for (const double sign : {1.0, -1.0}) {
          starts.emplace_back(best_pose_->rotation(), Vector3d(best_pose_->translation() + sign * steps.col(i)));
        }
      }
      if (!options_.same_orientation) {
        for (const Matrix3d &turn : lattice_turns(steps)) {
          starts.emplace_back(Matrix3d(turn * best_pose_->rotation_matrix()),
                              Vector3d(turn * (best_pose_->translation() - centre) + centre));
        }
      }
      runner_up_ = {};
      for (const Pose &start : starts) {
        Placement placement = growth_.from(start);
        if (same_pairs(placement.pairs, best_.pairs)) {
          continue;
        }
        if (placement.score > best_.score + 0.5) {
          best_ = std::move(placement);
          best_pose_ = rigid_fit(reference_, imaged_, best_.pairs);
          again = true;
          break;
        }
        if (placement.score > runner_up_.score) {
          runner_up_ = std::move(placement);
        }
      }
    }
  }

  void finish() {
    std::vector<MatchedPair> kept;
    double sum = 0.0;
    for (const MatchedPair &pair : best_.pairs) {
      if (pair.residual_mm <= growth_.limit()) {
        kept.push_back(pair);
        sum += pair.residual_mm * pair.residual_mm;
      }
    }
    result_.pairs = std::move(kept);
    const auto count = static_cast<double>(result_.pairs.size());
    result_.rms_residual_mm = count > 0.0 ? std::sqrt(sum / count) : 0.0;
    list_unmatched();
    const auto pose = rigid_fit(reference_, imaged_, result_.pairs);
    if (!pose || 2.0 * count < static_cast<double>(std::min(reference_.cols(), imaged_.cols()))) {
      result_.outcome = MatchOutcome::kNoMatch;
      return;
    }
    result_.T_imaged_reference = *pose;
    result_.outcome = MatchOutcome::kMatched;
    if (options_.same_orientation && geometry::rotation_log(pose->rotation()).norm() > options_.max_rotation_rad) {
      result_.outcome = MatchOutcome::kTurned;
      return;
    }
    const double margin = std::max(kMinAmbiguous, options_.ambiguous_share * count);
    if (best_.score - runner_up_.score < margin) {
      if (const auto other = rigid_fit(reference_, imaged_, runner_up_.pairs)) {
        result_.outcome = MatchOutcome::kAmbiguous;
        const Vector3d centre = reference_.rowwise().mean();
        result_.alternative = {geometry::angle_between(pose->rotation(), other->rotation()),
                               (*other * centre - *pose * centre).norm(), static_cast<Index>(runner_up_.pairs.size())};
      }
    }
  }

  void list_unmatched() {
    std::vector<bool> reference_used(static_cast<std::size_t>(reference_.cols())),
        imaged_used(static_cast<std::size_t>(imaged_.cols()));
    for (const MatchedPair &pair : result_.pairs) {
      reference_used[static_cast<std::size_t>(pair.reference)] = true;
      imaged_used[static_cast<std::size_t>(pair.imaged)] = true;
    }
    const Neighbourhoods n = nearest(best_.predicted, imaged_);
    const auto list = [&](const std::vector<bool> &used, const std::vector<bool> &partner_used,
                          const std::vector<Nearest> &partners, std::vector<UnmatchedPoint> &out) {
      for (std::size_t i = 0; i < used.size(); ++i) {
        if (used[i]) {
          continue;
        }
        const Nearest &partner = partners[i];
        const bool near = partner.distance_mm < kDoubled * spacing_mm_;
        const bool taken = near && partner_used[static_cast<std::size_t>(partner.index)];
        out.push_back({static_cast<Index>(i),
                       taken  ? UnmatchedReason::kDoubled
                       : near ? UnmatchedReason::kOffField
                              : UnmatchedReason::kNoPartner,
                       partner.distance_mm});
      }
    };
    list(reference_used, imaged_used, n.of_reference, result_.reference_unmatched);
    list(imaged_used, reference_used, n.of_imaged, result_.imaged_unmatched);
  }

  const MatchOptions &options_;
  const Points3 &reference_, &imaged_;
  double spacing_mm_;
  Explanation growth_;
  Placement best_, runner_up_;
  std::optional<Pose> best_pose_;
  MatchResult result_;
};

bool usable(const Points3 &a, const Points3 &b) {
  return a.cols() >= kMinMatched && b.cols() >= kMinMatched && a.allFinite() && b.allFinite();
}

} // namespace

const char *name(MatchOutcome outcome) noexcept {
  switch (outcome) {
  case MatchOutcome::kMatched:
    return "matched";
  case MatchOutcome::kAmbiguous:
    return "ambiguous";
  case MatchOutcome::kTurned:
    return "turned";
  case MatchOutcome::kNoMatch:
    return "no match";
  case MatchOutcome::kTooFewPoints:
    break;
  }
  return "too few points";
}

const char *name(UnmatchedReason reason) noexcept {
  switch (reason) {
  case UnmatchedReason::kIsolated:
    return "isolated";
  case UnmatchedReason::kDoubled:
    return "doubled";
  case UnmatchedReason::kOffField:
    return "off the smooth distortion";
  case UnmatchedReason::kNoPartner:
    break;
  }
  return "no partner";
}

Points3 MatchResult::reference_points(const Points3 &reference_mm) const {
  return moved(T_imaged_reference, select(reference_mm, true, pairs));
}

Points3 MatchResult::imaged_points(const Points3 &imaged_mm) const { return select(imaged_mm, false, pairs); }

MatchResult match_points(const Points3 &reference_mm, const Points3 &imaged_mm, const MatchOptions &options) {
  MatchResult out;
  if (!usable(reference_mm, imaged_mm)) {
    return out;
  }
  std::vector<UnmatchedPoint> reference_left_out, imaged_left_out;
  const std::vector<Index> reference_kept = usable_points(reference_mm, reference_left_out);
  const std::vector<Index> imaged_kept = usable_points(imaged_mm, imaged_left_out);
  const Points3 reference = reference_mm(Eigen::all, reference_kept), imaged = imaged_mm(Eigen::all, imaged_kept);
  if (usable(reference, imaged)) {
    out = Matching(reference, imaged, options).run();
  }
  for (MatchedPair &pair : out.pairs) {
    pair.reference = reference_kept[static_cast<std::size_t>(pair.reference)];
    pair.imaged = imaged_kept[static_cast<std::size_t>(pair.imaged)];
  }
  const auto restore = [](std::vector<UnmatchedPoint> &list, const std::vector<Index> &kept,
                          const std::vector<UnmatchedPoint> &left_out) {
    for (UnmatchedPoint &point : list) {
      point.index = kept[static_cast<std::size_t>(point.index)];
    }
    list.insert(list.end(), left_out.begin(), left_out.end());
    std::sort(list.begin(), list.end(), [](const auto &a, const auto &b) { return a.index < b.index; });
  };
  restore(out.reference_unmatched, reference_kept, reference_left_out);
  restore(out.imaged_unmatched, imaged_kept, imaged_left_out);
  return out;
}

std::vector<MatchedPair> wrong_pairs(const Points3 &reference_mm, const Points3 &imaged_mm, double max_residual_mm) {
  std::vector<MatchedPair> out;
  if (!usable(reference_mm, imaged_mm) || reference_mm.cols() != imaged_mm.cols()) {
    return out;
  }
  const double limit = max_residual_mm > 0.0 ? max_residual_mm : kResidualShare * median(nearest_distances(imaged_mm));
  const Points3 mapped = SmoothMap(reference_mm, imaged_mm, MatchOptions().max_degree)(reference_mm);
  for (Index i = 0; i < mapped.cols(); ++i) {
    if (const double residual = (mapped.col(i) - imaged_mm.col(i)).norm(); residual > limit) {
      out.push_back({i, i, residual});
    }
  }
  return out;
}

} // namespace bregma::mri
