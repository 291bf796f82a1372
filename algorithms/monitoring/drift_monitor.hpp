// Detects that the reference has moved against the head since the registration was accepted: a sequential test on check
// touches and surface residuals.
//
// Without drift a residual is e = J(p) x + l + v: x the error of the registration (one for all touches, prior
// covariance known), l the error of that landmark's place in the image (one for all its touches), v the touch. With
// drift a constant shift is added from some touch on. The test is the generalised likelihood ratio over the unknown
// shift and the unknown first touch, by the innovations of a Kalman filter without drift [Willsky 1976]. Errors that
// are common to all touches cancel, so that a landmark touched before and after a bump counts for more than one that
// was touched only after it. The common error of a scan is an unknown like the offset of a landmark.
//
// Frame: Image, mm. No allocation, no exceptions; one thread at a time.
#pragma once

#include <array>
#include <cstdint>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::monitoring {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;

struct CheckTouch {
  int landmark = 0;                                // index; landmarks beyond kMaxLandmarks count as touched once each
  Vector3d landmark_mm = Vector3d::Zero();         // position in the case
  Vector3d residual_mm = Vector3d::Zero();         // shown tip minus landmark
  Matrix3d touch_covariance = Matrix3d::Zero();    // error of this touch: tracker, pivot, placement; positive definite
  Matrix3d landmark_covariance = Matrix3d::Zero(); // error of its position in the image, common to all its touches
};

class DriftMonitor {
public:
  static constexpr int kMaxLandmarks = 16;
  static constexpr int kMaxOnsets =
      16; // hypotheses of a drift's first touch that are kept: the newest ones, and the first

  // false_alarm: maximum probability per touch when nothing has moved.
  explicit DriftMonitor(double false_alarm = 1e-4) noexcept;

  // To be called after a registration was accepted: clears all state. covariance is that of the accepted pose.
  void reset(const Matrix6d &registration_covariance) noexcept;

  void add_check(const CheckTouch &touch) noexcept;
  // signed_mm: distance of a traced point from the surface, positive outside; normal: outward unit normal there;
  // sigma_mm: error of the sample (skin, segmentation, tracker). Samples nearer than correlation_length_mm to one of
  // the last 16 used samples add no information and are left out. common_covariance: of an error that all samples of a
  // scan have in common, such as that of its sensor's beam and curve; not part of sigma_mm. It is one unknown, with the
  // covariance of the first such sample.
  void add_surface_residual(const Vector3d &point_mm, double signed_mm, double sigma_mm, const Vector3d &normal,
                            const Matrix3d &common_covariance = Matrix3d::Zero()) noexcept;

  // The 95 % bound of the length of this touch's residual if nothing has moved, from the covariances of registration,
  // landmark and touch [Satterthwaite 1946]. Earlier touches are not used.
  [[nodiscard]] double check_limit_95_mm(const CheckTouch &touch) const noexcept;

  [[nodiscard]] double statistic() const noexcept { return statistic_; } // present value, not the maximum so far
  [[nodiscard]] double threshold() const noexcept { return threshold_; }
  [[nodiscard]] bool detected() const noexcept { return detected_; } // stays until reset
  [[nodiscard]] int checks() const noexcept { return checks_; }
  // The most likely shift, and the number of touches since its onset; meaningful when detected.
  [[nodiscard]] const Vector3d &shift_mm() const noexcept { return shift_; }

private:
  static constexpr int kCommon = 6 + 3 * kMaxLandmarks; // of the scans
  static constexpr int kMaxState = kCommon + 3;
  static constexpr int kRecent = 16;
  using StateVector = Eigen::Matrix<double, kMaxState, 1>;
  using StateMatrix = Eigen::Matrix<double, kMaxState, kMaxState>;
  using Sensitivity = Eigen::Matrix<double, kMaxState, 3>;
  struct Onset {                             // a hypothesis: the shift began with this observation
    Sensitivity state = Sensitivity::Zero(); // derivative of the filter's state with respect to the shift
    Matrix3d information = Matrix3d::Zero();
    Vector3d score = Vector3d::Zero();
  };

  template <int Rows>
  void update(const Eigen::Matrix<double, Rows, kMaxState> &H, const Eigen::Matrix<double, Rows, 3> &shift_part,
              const Eigen::Matrix<double, Rows, 1> &observed, const Eigen::Matrix<double, Rows, Rows> &noise) noexcept;
  void open_onset() noexcept;
  void judge() noexcept;

  double threshold_;
  double statistic_ = 0.0;
  bool detected_ = false;
  int checks_ = 0;
  Vector3d shift_ = Vector3d::Zero();
  Matrix6d registration_covariance_ = Matrix6d::Zero();
  StateVector state_; // twist of the registration's error, the landmarks' offsets, the common error of scans
  StateMatrix covariance_;
  std::array<bool, kMaxLandmarks> known_{};
  bool common_known_ = false;
  std::array<Onset, kMaxOnsets> onsets_;
  int onset_count_ = 0;
  std::array<Vector3d, kRecent> recent_surface_;
  std::int64_t surface_count_ = 0;
};

} // namespace bregma::monitoring
