#include "algorithms/calibration/hand_eye.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <vector>

#include <Eigen/Dense>

#include "algorithms/calibration/rotation_spread.hpp"
#include "algorithms/geometry/angles.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::calibration {

namespace {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;
using geometry::Vector6d;
using Pose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Target>; // frames of the algebra do not matter
using Matrix12d = Eigen::Matrix<double, 12, 12>;
using Vector12d = Eigen::Matrix<double, 12, 1>;

constexpr int kMaxSteps = 50;
constexpr double kConverged = 1e-10;     // rad and mm of the last step
constexpr double kTranslated_rad = 0.02; // less rotation is noise
constexpr std::size_t kMinMotions = 3;

Pose plain(const HandEyePose &pose) { return pose.as<geometry::frame::Target, geometry::frame::Target>(); }

// Covariance of a left perturbation of a pose with this noise at its origin.
Matrix6d twist_covariance(const Pose &T, const PoseNoise &noise) {
  Matrix6d M = Matrix6d::Identity();
  M.bottomLeftCorner<3, 3>() = geometry::skew(T.translation());
  Vector6d variance;
  variance << Vector3d::Constant(noise.rotation_rad * noise.rotation_rad),
      Vector3d::Constant(noise.position_mm * noise.position_mm);
  return M * variance.asDiagonal() * M.transpose();
}

// X from motions, in closed form.
std::optional<Pose> start_from(std::span<const HandEyePair> motions) {
  Matrix3d correlation = Matrix3d::Zero();
  for (const HandEyePair &m : motions) {
    correlation += geometry::rotation_log(m.A.rotation()) * geometry::rotation_log(m.B.rotation()).transpose();
  }
  const Eigen::JacobiSVD<Matrix3d> svd(correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Matrix3d R = svd.matrixU() * Vector3d(1.0, 1.0, sign).asDiagonal() * svd.matrixV().transpose();
  // (R_A - I) t = R t_B - t_A
  Matrix3d normal = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const HandEyePair &m : motions) {
    const Matrix3d rows = m.A.rotation_matrix() - Matrix3d::Identity();
    normal += rows.transpose() * rows;
    right += rows.transpose() * (R * m.B.translation() - m.A.translation());
  }
  const Vector3d t = normal.ldlt().solve(right);
  return t.allFinite() ? std::optional(Pose(R, t)) : std::nullopt;
}

Pose moved(const Vector6d &twist, const Pose &T) {
  return Pose(geometry::rotation_exp(twist.head<3>()), twist.tail<3>()) * T;
}

struct Problem {
  std::span<const HandEyePair> pairs;
  const HandEyeOptions &options;
  bool absolute; // A X = Y B; otherwise Y is X

  // The twist is taken about the origin of the tracked body, so that rotation and position separate.
  struct Term {
    Vector6d residual;
    Eigen::Matrix<double, 6, 12> jacobian;
    Matrix6d covariance;
  };
  [[nodiscard]] Term term(const HandEyePair &pair, const Pose &X, const Pose &Y) const {
    const Pose A = plain(pair.A);
    const Pose B = plain(pair.B);
    const Pose seen = Y * B;
    Term out;
    // log(A X (Y B)^-1) = y + Ad_Y b - a - Ad_A x, with the errors a, b of A and B, and x, y of the estimates.
    out.jacobian.leftCols<6>() = -geometry::adjoint(A);
    out.jacobian.rightCols<6>().setIdentity();
    const Matrix6d ad = geometry::adjoint(Y);
    out.covariance = twist_covariance(A, options.robot) + ad * twist_covariance(B, options.tracker) * ad.transpose();
    Matrix6d at_body = Matrix6d::Identity();
    at_body.bottomLeftCorner<3, 3>() = -geometry::skew(seen.translation());
    const Pose carried = A * X;
    out.residual << geometry::rotation_log(carried.rotation() * seen.rotation().conjugate()),
        carried.translation() - seen.translation();
    out.jacobian = at_body * out.jacobian;
    out.covariance = at_body * out.covariance * at_body.transpose();
    if (!absolute) {
      out.jacobian.leftCols<6>() += out.jacobian.rightCols<6>();
      out.jacobian.rightCols<6>().setZero();
    }
    return out;
  }
};

template <class... Values> std::string sentence(const char *pattern, Values... values) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, pattern, values...);
  return buffer;
}

void judge(HandEyeResult &out, HandEyeVerdict verdict, std::string text) {
  out.verdict = verdict;
  out.text = (verdict == HandEyeVerdict::kAccepted ? "accepted: " : "refused: ") + std::move(text);
}

double worst_sigma_mm(const Matrix6d &covariance) {
  const Eigen::SelfAdjointEigenSolver<Matrix3d> axes(covariance.bottomRightCorner<3, 3>());
  return std::sqrt(axes.eigenvalues()[2]);
}

// False with the verdict where the pairs cannot determine X.
bool check_motion(std::span<const HandEyePair> pairs, bool absolute, const HandEyeOptions &options,
                  HandEyeResult &out) {
  const auto finite = [](const HandEyePose &T) {
    return T.translation().allFinite() && T.rotation().coeffs().allFinite();
  };
  if (!std::all_of(pairs.begin(), pairs.end(), [&](const HandEyePair &p) { return finite(p.A) && finite(p.B); })) {
    judge(out, HandEyeVerdict::kInvalidPose, "a pose is not finite");
    return false;
  }
  if (pairs.size() < kMinMotions + (absolute ? 1 : 0)) {
    judge(out, HandEyeVerdict::kTooFewPoses,
          sentence("%zu %s, at least %zu are needed", pairs.size(), absolute ? "poses" : "motions",
                   kMinMotions + (absolute ? 1 : 0)));
    return false;
  }
  std::vector<Eigen::Quaterniond> rotations;
  rotations.reserve(pairs.size() + 1);
  for (const HandEyePair &pair : pairs) {
    rotations.push_back(pair.A.rotation());
  }
  if (!absolute) {
    rotations.push_back(Eigen::Quaterniond::Identity()); // where the motions start
  }
  const auto ranges = rotation_ranges(rotations);
  out.rotation_rad[0] = ranges[0];
  out.rotation_rad[1] = ranges[1];
  const double wide = ranges[0] / geometry::kRadiansPerDegree;
  if (ranges[0] < kTranslated_rad) {
    judge(out, HandEyeVerdict::kNoRotation,
          sentence("the flange was only translated (it turned by %.1f degrees)", wide));
    return false;
  }
  if (ranges[1] < options.min_rotation_rad) {
    judge(out, HandEyeVerdict::kOneAxis,
          sentence("the flange was turned by %.0f degrees about one axis and by %.1f about the others; at least %.0f "
                   "about two axes are needed",
                   wide, ranges[1] / geometry::kRadiansPerDegree,
                   options.min_rotation_rad / geometry::kRadiansPerDegree));
    return false;
  }
  return true;
}

// Relative motions from each pose to the one half the list further on: wide ones, each pose in two.
std::vector<HandEyePair> motions_between(std::span<const HandEyePair> poses) {
  std::vector<HandEyePair> out;
  const std::size_t apart = std::max<std::size_t>(1, poses.size() / 2);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const HandEyePair &from = poses[i];
    const HandEyePair &to = poses[(i + apart) % poses.size()];
    if (&from != &to) {
      // A1 X = Y B1 and A2 X = Y B2 give (A1^-1 A2) X = X (B1^-1 B2).
      out.push_back({(plain(from.A).inverse() * plain(to.A)).as<geometry::frame::Target, geometry::frame::Source>(),
                     (plain(from.B).inverse() * plain(to.B)).as<geometry::frame::Target, geometry::frame::Source>()});
    }
  }
  return out;
}

void estimate(const Problem &problem, Pose X, Pose Y, HandEyeResult &out) {
  const Eigen::Index free = problem.absolute ? 12 : 6;
  Eigen::MatrixXd normal;
  bool converged = false;
  for (int step = 0; step < kMaxSteps && !converged; ++step) {
    Matrix12d sum = Matrix12d::Zero();
    Vector12d gradient = Vector12d::Zero();
    for (const HandEyePair &pair : problem.pairs) {
      const Problem::Term t = problem.term(pair, X, Y);
      const Eigen::LDLT<Matrix6d> weight(t.covariance);
      sum += t.jacobian.transpose() * weight.solve(t.jacobian);
      gradient += t.jacobian.transpose() * weight.solve(t.residual);
    }
    normal = sum.topLeftCorner(free, free);
    Vector12d move = Vector12d::Zero();
    move.head(free) = normal.ldlt().solve(gradient.head(free));
    if (!move.allFinite()) {
      break;
    }
    X = moved(move.head<6>(), X);
    Y = problem.absolute ? moved(move.tail<6>(), Y) : X;
    converged = move.cwiseAbs().maxCoeff() < kConverged;
  }
  if (!converged) {
    judge(out, HandEyeVerdict::kNotConverged, "the estimate did not converge: do the two lists belong together?");
    return;
  }
  out.estimated = true;
  out.X = X.as<geometry::frame::Target, geometry::frame::Source>();
  out.Y = Y.as<geometry::frame::Target, geometry::frame::Source>();
  out.joint.topLeftCorner(free, free) = normal.ldlt().solve(Eigen::MatrixXd::Identity(free, free));
  out.covariance_X = out.joint.topLeftCorner<6, 6>();
  out.covariance_Y = problem.absolute ? Matrix6d(out.joint.bottomRightCorner<6, 6>()) : out.covariance_X;
  double rotation = 0.0;
  double position = 0.0;
  for (const HandEyePair &pair : problem.pairs) {
    const Problem::Term t = problem.term(pair, X, Y);
    rotation += t.residual.head<3>().squaredNorm();
    position += t.residual.tail<3>().squaredNorm();
    out.chi_square += t.residual.dot(t.covariance.ldlt().solve(t.residual));
  }
  const auto n = static_cast<double>(problem.pairs.size());
  out.rms_rotation_rad = std::sqrt(rotation / n);
  out.rms_position_mm = std::sqrt(position / n);
  out.p_value = uncertainty::chi_square_survival(out.chi_square, 6.0 * n - static_cast<double>(free));
}

HandEyeResult calibrate(std::span<const HandEyePair> pairs, std::span<const HandEyePair> motions, bool absolute,
                        const HandEyeOptions &options) {
  HandEyeResult out;
  out.pairs = pairs.size();
  if (!check_motion(pairs, absolute, options, out)) {
    return out;
  }
  const auto X = start_from(motions);
  if (!X) {
    judge(out, HandEyeVerdict::kPoorlyObserved, "the motions do not determine the position of the body");
    return out;
  }
  const Pose Y = absolute ? plain(pairs[0].A) * *X * plain(pairs[0].B).inverse() : *X;
  estimate({pairs, options, absolute}, *X, Y, out);
  if (!out.estimated) {
    return out;
  }
  const double sigma_X = worst_sigma_mm(out.covariance_X);
  const double sigma_Y = worst_sigma_mm(out.covariance_Y);
  const double free = absolute ? 12.0 : 6.0;
  const double ratio = std::sqrt(out.chi_square / (6.0 * static_cast<double>(pairs.size()) - free));
  if (!(std::max(sigma_X, sigma_Y) <= options.max_sigma_mm)) {
    judge(out, HandEyeVerdict::kPoorlyObserved,
          sentence("the motion determines X to %.1f mm and Y to %.1f mm (1 sigma, worst direction), at most %.1f mm is "
                   "allowed: turn the flange further",
                   sigma_X, sigma_Y, options.max_sigma_mm));
  } else if (!(out.p_value >= options.min_p_value)) {
    judge(out, HandEyeVerdict::kFitsBadly,
          sentence("the residuals (%.2f mm, %.3f degrees) are %.1f times as large as the stated errors",
                   out.rms_position_mm, out.rms_rotation_rad / geometry::kRadiansPerDegree, ratio));
  } else {
    judge(out, HandEyeVerdict::kAccepted,
          sentence("X is known to %.3f mm and Y to %.3f mm (1 sigma, worst direction), residuals %.2f times the stated "
                   "errors over %zu pairs",
                   sigma_X, sigma_Y, ratio, pairs.size()));
  }
  return out;
}

} // namespace

HandEyeResult calibrate_hand_eye_motions(std::span<const HandEyePair> motions, const HandEyeOptions &options) {
  return calibrate(motions, motions, false, options);
}

HandEyeResult calibrate_hand_eye(std::span<const HandEyePair> poses, const HandEyeOptions &options) {
  return calibrate(poses, motions_between(poses), true, options);
}

} // namespace bregma::calibration
