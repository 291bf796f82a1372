#include "algorithms/registration/points/robust_points.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::registration {

namespace {

constexpr int kMaxRounds = 10;
constexpr double kHopeless = 1e-6; // an agreement that is less probable than this does not count

// Statistics of the residual of pairs[i] under T, optionally with T's covariance (an outlier's prediction by the
// others).
double misfit(const PointPair &pair, const PairedPose &T, const Matrix6d *pose_covariance) {
  const Matrix3d R = T.rotation_matrix();
  const Vector3d mapped = T * pair.source_mm;
  Matrix3d S = R * pair.source_covariance * R.transpose() + pair.target_covariance;
  if (pose_covariance != nullptr) {
    const geometry::Matrix36d J = geometry::point_jacobian(mapped);
    S += J * *pose_covariance * J.transpose();
  }
  const Vector3d r = mapped - pair.target_mm;
  const double chi = r.dot(S.llt().solve(r));
  return std::isfinite(chi) ? chi : std::numeric_limits<double>::infinity();
}

struct Proposal {
  int agree = 0;
  double cost = std::numeric_limits<double>::infinity(); // sum of min(chi-square, limit)
  PairedPose pose;
};

// A triple's own error makes the pose about as uncertain as the points; lever arms can double it. A generous limit here
// costs nothing, since pairs are tested exactly afterwards.
constexpr double kProposalSlack = 6.0;

Proposal best_proposal(std::span<const PointPair> pairs, double limit) {
  Proposal best;
  const auto n = pairs.size();
  const auto triples = n * (n - 1) * (n - 2) / 6;
  const std::size_t stride = (triples + kMaxTriples - 1) / kMaxTriples;
  std::size_t index = 0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      for (std::size_t k = j + 1; k < n; ++k) {
        if (index++ % stride != 0) {
          continue;
        }
        const std::array<Vector3d, 3> source = {pairs[i].source_mm, pairs[j].source_mm, pairs[k].source_mm};
        const std::array<Vector3d, 3> target = {pairs[i].target_mm, pairs[j].target_mm, pairs[k].target_mm};
        const auto pose = fit_rigid(source, target);
        if (!pose) {
          continue;
        }
        Proposal proposal{0, 0.0, *pose};
        for (const PointPair &pair : pairs) {
          const double chi = misfit(pair, *pose, nullptr);
          proposal.agree += chi < kProposalSlack * limit ? 1 : 0;
          proposal.cost += std::min(chi, kProposalSlack * limit);
        }
        if (proposal.cost < best.cost) {
          best = proposal;
        }
      }
    }
  }
  return best;
}

// Three of four pairs agree with three degrees of freedom. Other triples may agree as well by chance; the wrong pair
// cannot be identified then.
bool only_three_agree(std::span<const PointPair> four, const RobustFit &fit, double false_alarm) {
  for (std::size_t left_out = 0; left_out < four.size(); ++left_out) {
    std::array<PointPair, 3> rest;
    std::copy_if(four.begin(), four.end(), rest.begin(), [&](const PointPair &p) { return &p != &four[left_out]; });
    const PairedFit other = fit_paired(rest);
    const bool agree = other.converged && other.p_value >= false_alarm;
    if (agree == fit.inlier[left_out]) {
      return false;
    }
  }
  return true;
}

} // namespace

RobustFit fit_paired_robust(std::span<const PointPair> pairs, const RobustOptions &options) noexcept {
  RobustFit out;
  if (pairs.size() < 3 || pairs.size() > kMaxPairs || !(options.false_alarm > 0.0 && options.false_alarm < 1.0)) {
    return out;
  }
  out.count = static_cast<int>(pairs.size());
  const std::size_t min_pairs = pairs.size() == 4 ? 3 : 4;
  const double each = 1.0 - std::pow(1.0 - options.false_alarm, 1.0 / out.count);
  const double limit = uncertainty::chi_square_upper_quantile(each, 3);
  const Proposal proposal = best_proposal(pairs, limit);
  if (!std::isfinite(proposal.cost)) {
    return out;
  }
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    out.inlier[i] = misfit(pairs[i], proposal.pose, nullptr) < kProposalSlack * limit;
  }

  std::array<PointPair, kMaxPairs> chosen;
  std::array<std::size_t, kMaxPairs> index{};
  PairedFit fit;
  std::size_t used = 0;
  for (int round = 0; round < kMaxRounds; ++round) {
    used = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (out.inlier[i]) {
        chosen[used] = pairs[i];
        index[used++] = i;
      }
    }
    fit = fit_paired({chosen.data(), used}, &proposal.pose);
    if (!fit.converged) {
      return out;
    }
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (!out.inlier[i]) {
        out.p_value[i] = uncertainty::chi_square_survival(misfit(pairs[i], fit.T_target_source, &fit.covariance), 3);
      }
    }
    std::size_t worst = pairs.size();
    for (std::size_t c = 0; c < used; ++c) {
      out.p_value[index[c]] = fit.fiducials[c].p_value;
      if (fit.fiducials[c].p_value < each && (worst == pairs.size() || out.p_value[index[c]] < out.p_value[worst])) {
        worst = index[c];
      }
    }
    // Only the worst is removed at a time, since it affects the others' residuals; pairs that fit then are included
    // again.
    bool changed = false;
    if (worst < pairs.size() && used > min_pairs) {
      out.inlier[worst] = false;
      changed = true;
    } else {
      for (std::size_t i = 0; i < pairs.size(); ++i) {
        if (!out.inlier[i] && out.p_value[i] > 2.0 * each) {
          out.inlier[i] = true;
          changed = true;
        }
      }
    }
    if (!changed) {
      break;
    }
  }

  out.fit = fit;
  for (std::size_t c = 0; c < used; ++c) {
    out.fit.fiducials[index[c]] = fit.fiducials[c];
  }
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!out.inlier[i]) {
      FiducialFit &outlier = out.fit.fiducials[i];
      outlier = {};
      outlier.residual_mm = fit.T_target_source * pairs[i].source_mm - pairs[i].target_mm;
      outlier.norm_mm = outlier.leave_one_out_mm = outlier.residual_mm.norm();
      outlier.chi_square = misfit(pairs[i], fit.T_target_source, &fit.covariance);
      outlier.p_value = out.p_value[i];
    }
  }
  out.outliers = out.count - static_cast<int>(used);
  out.found = used >= min_pairs && 2 * used > pairs.size() && fit.p_value >= kHopeless &&
              (used > 3 || only_three_agree(pairs, out, options.false_alarm));
  return out;
}

double fre_p_value(int fiducials, double fre_rms_mm, double fle_rms_mm) noexcept {
  if (fiducials < 3 || !(fle_rms_mm > 0.0)) {
    return geometry::kUnknown;
  }
  const double chi = 3.0 * fiducials * fre_rms_mm * fre_rms_mm / (fle_rms_mm * fle_rms_mm);
  return uncertainty::chi_square_survival(chi, 3 * fiducials - 6);
}

} // namespace bregma::registration
