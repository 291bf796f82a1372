// Does a hand-eye calibration still hold? The tracked body on the flange is where the chain puts it,
// T_base_tracker^-1 T_base_flange T_flange_body, or the tracker was moved against the arm, the body on the flange, or
// the two devices' times disagree.
//
// The statistic is the squared Mahalanobis distance of the two poses (6 degrees of freedom), with the errors of
// calibration, flange and markers: a calibration within its error passes. It disagrees from kFrames frames in a row
// beyond the threshold on, until ten in a row pass. While the body is not seen nothing is judged anew.
//
// One thread. No allocation, no exceptions.
#pragma once

#include <cstdint>
#include <limits>

#include "casefile/robot_tools.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

class HandEyeCheck {
public:
  static constexpr double kThreshold = 38.3; // exceeded with probability 1e-6
  static constexpr int kFrames = 3;          // in a row, that disagree
  static constexpr int kAgreeing = 10;       // in a row, that end a disagreement

  void reset() noexcept { *this = HandEyeCheck{}; }
  void add(const casefile::HandEyeModel &model,
           const geometry::UncertainPose<geometry::frame::RobotBase, geometry::frame::RobotFlange> &T_base_flange,
           const geometry::UncertainPose<geometry::frame::Tracker, geometry::frame::Tool> &T_tracker_body,
           std::int64_t acquired_ns) noexcept {
    view_.checked_ns = acquired_ns;
    const auto T_tracker_base = model.T_base_tracker.pose.inverse();
    const auto predicted = T_tracker_base * T_base_flange.pose * model.T_flange_body.pose;
    const auto apart = T_tracker_body.pose * predicted.inverse();
    geometry::Vector6d error;
    error << geometry::rotation_log(apart.rotation()), apart.translation();
    Eigen::Matrix<double, 6, 12> J; // of the calibrated body and tracker
    J << geometry::adjoint(T_tracker_base * T_base_flange.pose), -geometry::adjoint(T_tracker_base);
    const geometry::Matrix6d of_base = J.rightCols<6>();
    const geometry::Matrix6d covariance = J * model.joint * J.transpose() +
                                          of_base * T_base_flange.covariance * of_base.transpose() +
                                          T_tracker_body.covariance;
    view_.statistic = error.dot(covariance.ldlt().solve(error));
    view_.distance_mm = (T_tracker_body.pose.translation() - predicted.translation()).norm();
    const bool agrees = view_.statistic <= kThreshold; // not: NaN
    agreeing_ = agrees ? agreeing_ + 1 : 0;
    disagreeing_ = agrees ? 0 : disagreeing_ + 1;
    view_.disagrees = view_.disagrees ? agreeing_ < kAgreeing : disagreeing_ >= kFrames;
    agreeing_ = agreeing_ > kAgreeing ? kAgreeing : agreeing_;
    disagreeing_ = disagreeing_ > kFrames ? kFrames : disagreeing_;
  }

  [[nodiscard]] bool disagrees() const noexcept { return view_.disagrees; }
  [[nodiscard]] const HandEyeView &view() const noexcept { return view_; }

private:
  HandEyeView view_{.statistic = std::numeric_limits<double>::quiet_NaN(),
                    .distance_mm = std::numeric_limits<double>::quiet_NaN()};
  int agreeing_ = 0, disagreeing_ = 0; // frames in a row
};

} // namespace bregma::server
