#include "algorithms/monitoring/drift_monitor.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::monitoring {

namespace {

// The hypotheses are tested together, but share most of their data: they correspond to this many independent tests.
// Measured: DriftMonitor.CleanTouchesRaiseNoAlarm counts the false alarms.
constexpr double kIndependentOnsets = 4.0;
constexpr double kCorrelation_mm = 12.0; // surface samples nearer than this are correlated
constexpr int kSurfaceBurst = 8;         // surface samples per hypothesis

} // namespace

DriftMonitor::DriftMonitor(double false_alarm) noexcept
    : threshold_(uncertainty::chi_square_upper_quantile(false_alarm / kIndependentOnsets, 3)) {
  reset(Matrix6d::Zero());
}

void DriftMonitor::reset(const Matrix6d &registration_covariance) noexcept {
  statistic_ = 0.0;
  detected_ = false;
  checks_ = 0;
  shift_.setZero();
  registration_covariance_ = registration_covariance;
  state_.setZero();
  covariance_.setZero();
  covariance_.topLeftCorner<6, 6>() = registration_covariance;
  known_.fill(false);
  common_known_ = false;
  onset_count_ = 0;
  surface_count_ = 0;
}

// The newest hypothesis: the shift begins with the next observation. The first one is always kept, so that a
// registration that was wrong from the beginning is detected too.
void DriftMonitor::open_onset() noexcept {
  if (onset_count_ == kMaxOnsets) {
    std::move(onsets_.begin() + 2, onsets_.end(), onsets_.begin() + 1);
    --onset_count_;
  }
  onsets_[static_cast<std::size_t>(onset_count_++)] = Onset{};
}

// One step of the filter without drift, and of every hypothesis, for a state that does not change between observations
// [Willsky 1976, eqs. 11-17].
template <int Rows>
void DriftMonitor::update(const Eigen::Matrix<double, Rows, kMaxState> &H,
                          const Eigen::Matrix<double, Rows, 3> &shift_part,
                          const Eigen::Matrix<double, Rows, 1> &observed,
                          const Eigen::Matrix<double, Rows, Rows> &noise) noexcept {
  using Block = Eigen::Matrix<double, Rows, Rows>;
  using Gain = Eigen::Matrix<double, kMaxState, Rows>;
  const Gain PHt = covariance_ * H.transpose();
  const Block S = H * PHt + noise;
  const Block S_inverse = Eigen::LDLT<Block>(S).solve(Block::Identity());
  const Gain K = PHt * S_inverse;
  const Eigen::Matrix<double, Rows, 1> innovation = observed - H * state_;
  for (int i = 0; i < onset_count_; ++i) {
    Onset &onset = onsets_[static_cast<std::size_t>(i)];
    const Eigen::Matrix<double, Rows, 3> signature = shift_part - H * onset.state;
    onset.state += K * signature;
    onset.information += signature.transpose() * S_inverse * signature;
    onset.score += signature.transpose() * S_inverse * innovation;
  }
  state_ += K * innovation;
  covariance_ -= K * PHt.transpose();
}

void DriftMonitor::judge() noexcept {
  statistic_ = 0.0;
  for (int i = 0; i < onset_count_; ++i) {
    const Onset &onset = onsets_[static_cast<std::size_t>(i)];
    // Surface residuals alone may leave directions of the shift undetermined: those are not used.
    const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(onset.information);
    Vector3d shift = Vector3d::Zero();
    for (int k = 0; k < 3; ++k) {
      if (solver.eigenvalues()[k] > 1e-6) {
        const Vector3d axis = solver.eigenvectors().col(k);
        shift += axis * (axis.dot(onset.score) / solver.eigenvalues()[k]);
      }
    }
    const double likelihood = onset.score.dot(shift); // twice the logarithm of the ratio
    if (likelihood > statistic_) {
      statistic_ = likelihood;
      shift_ = shift;
    }
  }
  detected_ = detected_ || statistic_ > threshold_;
}

void DriftMonitor::add_check(const CheckTouch &touch) noexcept {
  if (!touch.residual_mm.allFinite() || !touch.landmark_mm.allFinite()) {
    return;
  }
  Eigen::Matrix<double, 3, kMaxState> H = Eigen::Matrix<double, 3, kMaxState>::Zero();
  H.leftCols<6>() = geometry::point_jacobian(touch.landmark_mm);
  Matrix3d noise = touch.touch_covariance;
  if (touch.landmark >= 0 && touch.landmark < kMaxLandmarks) {
    const int column = 6 + 3 * touch.landmark;
    H.middleCols<3>(column).setIdentity();
    bool &known = known_[static_cast<std::size_t>(touch.landmark)];
    if (!known) {
      covariance_.block<3, 3>(column, column) = touch.landmark_covariance;
      known = true;
    }
  } else {
    noise += touch.landmark_covariance;
  }
  open_onset();
  update<3>(H, Matrix3d::Identity(), touch.residual_mm, noise);
  ++checks_;
  judge();
}

void DriftMonitor::add_surface_residual(const Vector3d &point_mm, double signed_mm, double sigma_mm,
                                        const Vector3d &normal, const Matrix3d &common_covariance) noexcept {
  if (!point_mm.allFinite() || !normal.allFinite() || !std::isfinite(signed_mm) || !(sigma_mm > 0.0) ||
      !common_covariance.allFinite()) {
    return;
  }
  const auto kept = static_cast<std::size_t>(std::min<std::int64_t>(surface_count_, kRecent));
  for (std::size_t i = 0; i < kept; ++i) {
    if ((recent_surface_[i] - point_mm).squaredNorm() < kCorrelation_mm * kCorrelation_mm) {
      return;
    }
  }
  recent_surface_[static_cast<std::size_t>(surface_count_ % kRecent)] = point_mm;
  if (surface_count_++ % kSurfaceBurst == 0) {
    open_onset();
  }
  Eigen::Matrix<double, 1, kMaxState> H = Eigen::Matrix<double, 1, kMaxState>::Zero();
  H.leftCols<6>() = normal.transpose() * geometry::point_jacobian(point_mm);
  if (common_covariance.trace() > 0.0) {
    H.middleCols<3>(kCommon) = normal.transpose();
    if (!common_known_) {
      covariance_.block<3, 3>(kCommon, kCommon) = common_covariance;
      common_known_ = true;
    }
  }
  update<1>(H, normal.transpose(), Eigen::Matrix<double, 1, 1>(signed_mm),
            Eigen::Matrix<double, 1, 1>(sigma_mm * sigma_mm));
  judge();
}

double DriftMonitor::check_limit_95_mm(const CheckTouch &touch) const noexcept {
  const geometry::Matrix36d J = geometry::point_jacobian(touch.landmark_mm);
  const Matrix3d C = J * registration_covariance_ * J.transpose() + touch.landmark_covariance + touch.touch_covariance;
  // The squared length is about g times a chi-square of h degrees of freedom [Satterthwaite 1946].
  const double mean = C.trace();
  const double g = C.squaredNorm() / mean;
  const double h = mean / g;
  return std::sqrt(g * uncertainty::chi_square_upper_quantile(0.05, h));
}

} // namespace bregma::monitoring
