#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "algorithms/monitoring/drift_monitor.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;
using geometry::Vector6d;
using monitoring::CheckTouch;
using monitoring::DriftMonitor;
constexpr unsigned kSeed = 20260204;

// A session: the registration and landmark errors are drawn once, the touch errors per touch.
class Session {
public:
  Session(std::mt19937 &rng, double touch_sigma_mm, double landmark_sigma_mm)
      : rng_(rng), touch_(touch_sigma_mm * touch_sigma_mm * Matrix3d::Identity()),
        placed_(landmark_sigma_mm * landmark_sigma_mm * Matrix3d::Identity()) {
    // TRE of 0.5 to 0.7 mm RMS at the skin.
    Vector6d sigma;
    sigma << 0.0025, 0.0025, 0.003, 0.25, 0.25, 0.25;
    registration_covariance_ = sigma.cwiseAbs2().asDiagonal();
    std::normal_distribution<double> normal;
    for (int i = 0; i < 6; ++i) {
      twist_[i] = sigma[i] * normal(rng);
    }
    for (const Vector3d &direction :
         {Vector3d(0, 1, 0.2), Vector3d(-1, 0.2, 0.4), Vector3d(0.9, 0.3, 0.5), Vector3d(0, -0.3, 1)}) {
      landmarks_.push_back(test::on_head(direction));
      placements_.push_back(test::normal_vector(rng, landmark_sigma_mm));
    }
  }

  [[nodiscard]] CheckTouch touch(int landmark, const Vector6d &bump = Vector6d::Zero()) {
    const auto i = static_cast<std::size_t>(landmark) % landmarks_.size();
    const Vector3d &p = landmarks_[i];
    const Vector3d error = geometry::point_jacobian(p) * (twist_ + bump) + placements_[i] + test::draw(rng_, touch_);
    return {static_cast<int>(i), p, error, touch_, placed_};
  }
  [[nodiscard]] const Matrix6d &registration_covariance() const { return registration_covariance_; }
  [[nodiscard]] const std::vector<Vector3d> &landmarks() const { return landmarks_; }

private:
  std::mt19937 &rng_;
  Matrix3d touch_;
  Matrix3d placed_;
  Matrix6d registration_covariance_;
  Vector6d twist_;
  std::vector<Vector3d> landmarks_;
  std::vector<Vector3d> placements_;
};

// The reference, 150 mm from the head, moves by 2 mm and rotates slightly. The displacement is about 2 mm everywhere.
Vector6d bump(std::mt19937 &rng, double shift_mm) {
  Vector6d out;
  const Vector3d turn = test::normal_vector(rng, 0.3 * M_PI / 180.0);
  out << turn, shift_mm * test::normal_vector(rng, 1.0).normalized() - turn.cross(test::kHeadCentre);
  return out;
}

struct Detection {
  int by_touch[4] = {};
  int runs = 0;
};

Detection detect(double touch_sigma_mm, double landmark_sigma_mm, int baseline) {
  std::mt19937 rng(kSeed);
  Detection out;
  for (out.runs = 0; out.runs < 2000; ++out.runs) {
    Session session(rng, touch_sigma_mm, landmark_sigma_mm);
    DriftMonitor monitor;
    monitor.reset(session.registration_covariance());
    for (int i = 0; i < baseline; ++i) {
      monitor.add_check(session.touch(i));
    }
    if (monitor.detected()) {
      continue;
    }
    const Vector6d moved = bump(rng, 2.0);
    int found = 3;
    for (int i = 0; i < 3; ++i) {
      monitor.add_check(session.touch(i, moved));
      if (monitor.detected()) {
        found = i;
        break;
      }
    }
    ++out.by_touch[found];
  }
  return out;
}

void print(const char *what, const Detection &d) {
  std::printf("%s: found at the 1st touch %.2f %%, 2nd %.2f %%, 3rd %.2f %%, later %.2f %% of %d (seed %u)\n", what,
              100.0 * d.by_touch[0] / d.runs, 100.0 * d.by_touch[1] / d.runs, 100.0 * d.by_touch[2] / d.runs,
              100.0 * d.by_touch[3] / d.runs, d.runs, kSeed);
}

TEST(DriftMonitor, ABumpOf2mmIsFoundBeforeTheThirdTouch) {
  const Detection d = detect(0.25, 0.3, 4); // touch error of 0.43 mm RMS
  print("touches of 0.43 mm", d);
  EXPECT_GE(d.by_touch[0] + d.by_touch[1], 0.99 * d.runs);
}

TEST(DriftMonitor, ABumpOf2mmIsFoundByUnsteadyHandsWithTheThirdTouch) {
  const Detection d = detect(0.35, 0.3, 4); // touch error of 0.61 mm RMS
  print("touches of 0.61 mm", d);
  EXPECT_GE(d.by_touch[0] + d.by_touch[1], 0.9 * d.runs);
  EXPECT_LE(d.by_touch[3], 0.01 * d.runs);
}

TEST(DriftMonitor, EarlierTouchesOfTheSameLandmarksImproveDetection) {
  const Detection without = detect(0.25, 0.3, 0);
  print("never touched before", without);
  const Detection with = detect(0.25, 0.3, 4);
  EXPECT_GT(with.by_touch[0], 2 * without.by_touch[0]);
}

TEST(DriftMonitor, CleanTouchesRaiseNoAlarm) {
  constexpr int kTouches = 20'000;
  for (const double touch_sigma : {0.25, 0.5}) {
    for (const int length : {5, 40}) {
      std::mt19937 rng(kSeed);
      int alarms = 0;
      for (int i = 0; i < kTouches / length; ++i) {
        Session session(rng, touch_sigma, 0.3);
        DriftMonitor monitor;
        monitor.reset(session.registration_covariance());
        for (int k = 0; k < length; ++k) {
          monitor.add_check(session.touch(k));
        }
        alarms += monitor.detected() ? 1 : 0;
      }
      std::printf("%d false alarms in %d clean touches, %d a session, %.2f mm a coordinate (seed %u)\n", alarms,
                  kTouches, length, touch_sigma, kSeed);
      EXPECT_LE(alarms, 5);
    }
  }
}

TEST(DriftMonitor, EstimatesTheShift) {
  std::mt19937 rng(kSeed);
  Session session(rng, 0.1, 0.0);
  DriftMonitor monitor;
  monitor.reset(session.registration_covariance());
  for (int i = 0; i < 4; ++i) {
    monitor.add_check(session.touch(i));
  }
  EXPECT_FALSE(monitor.detected());
  EXPECT_LT(monitor.statistic(), monitor.threshold());
  Vector6d moved = Vector6d::Zero();
  moved.tail<3>() = Vector3d(0.0, 2.0, 0.0);
  for (int i = 0; i < 4; ++i) {
    monitor.add_check(session.touch(i, moved));
  }
  EXPECT_TRUE(monitor.detected());
  EXPECT_LT((monitor.shift_mm() - Vector3d(0.0, 2.0, 0.0)).norm(), 0.4) << monitor.shift_mm().transpose();
  EXPECT_EQ(monitor.checks(), 8);
  monitor.reset(session.registration_covariance());
  EXPECT_FALSE(monitor.detected());
  EXPECT_EQ(monitor.statistic(), 0.0);
  EXPECT_EQ(monitor.checks(), 0);
}

// Skin traced again after the registration was accepted.
struct SurfaceRun {
  int detected = 0;
  int runs = 0;
};
// Skin scanned by a sensor whose calibration has an error in common to all samples, and a bump halfway.
SurfaceRun scan_again(double shift_mm, bool common_stated) {
  constexpr double kCommon_mm = 1.0;
  std::mt19937 rng(kSeed);
  const auto mesh = test::make_head(3);
  SurfaceRun out;
  for (out.runs = 0; out.runs < 100; ++out.runs) {
    Session session(rng, 0.3, 0.3);
    DriftMonitor monitor;
    monitor.reset(session.registration_covariance());
    const Vector6d moved = bump(rng, shift_mm);
    std::normal_distribution<double> normal;
    const Vector3d common = kCommon_mm * Vector3d(normal(rng), normal(rng), normal(rng));
    const Matrix3d stated = common_stated ? Matrix3d(kCommon_mm * kCommon_mm * Matrix3d::Identity()) : Matrix3d::Zero();
    const auto spots = test::spots(mesh, 150, rng, [](const Vector3d &p) { return p.z() > 20.0; });
    for (std::size_t i = 0; i < spots.size(); ++i) {
      const bool after = shift_mm > 0.0 && 2 * i >= spots.size();
      const Vector3d error = common + geometry::point_jacobian(spots[i].point_mm) * (after ? moved : Vector6d::Zero());
      monitor.add_surface_residual(spots[i].point_mm, spots[i].normal.dot(error) + 0.7 * normal(rng), 0.7,
                                   spots[i].normal, stated);
    }
    out.detected += monitor.detected() ? 1 : 0;
  }
  return out;
}

TEST(DriftMonitor, AnErrorThatAScanHasInCommonIsNoDrift) {
  const SurfaceRun unstated = scan_again(0.0, false);
  const SurfaceRun clean = scan_again(0.0, true);
  const SurfaceRun moved = scan_again(3.0, true);
  std::printf(
      "common error of 1 mm: %d false alarms of %d if it is not stated, %d if it is; 3 mm halfway: found in %d\n",
      unstated.detected, unstated.runs, clean.detected, moved.detected);
  EXPECT_GE(unstated.detected, 30) << "the error is large enough to matter";
  EXPECT_LE(clean.detected, 1);
  EXPECT_GE(moved.detected, 90);
}

SurfaceRun trace_again(double shift_mm) {
  std::mt19937 rng(kSeed);
  const auto mesh = test::make_head(3);
  SurfaceRun out;
  for (out.runs = 0; out.runs < 200; ++out.runs) {
    Session session(rng, 0.3, 0.3);
    DriftMonitor monitor;
    monitor.reset(session.registration_covariance());
    const Vector6d moved = bump(rng, shift_mm);
    Vector6d sigma = session.registration_covariance().diagonal().cwiseSqrt();
    std::normal_distribution<double> normal;
    for (double &s : sigma) {
      s *= normal(rng);
    }
    for (const auto &spot : test::spots(mesh, 150, rng, [](const Vector3d &p) { return p.z() > 20.0; })) {
      const Vector3d error =
          geometry::point_jacobian(spot.point_mm) * (sigma + (shift_mm > 0.0 ? moved : Vector6d::Zero()));
      monitor.add_surface_residual(spot.point_mm, spot.normal.dot(error) + 0.7 * normal(rng), 0.7, spot.normal);
    }
    out.detected += monitor.detected() ? 1 : 0;
  }
  return out;
}

TEST(DriftMonitor, SurfaceTracedAgainFindsAShiftToo) {
  const SurfaceRun moved = trace_again(3.0);
  const SurfaceRun clean = trace_again(0.0);
  std::printf("3 mm: found in %d of %d traces; clean: %d of %d (seed %u)\n", moved.detected, moved.runs, clean.detected,
              clean.runs, kSeed);
  EXPECT_GE(moved.detected, 190);
  EXPECT_LE(clean.detected, 1);
}

TEST(DriftMonitor, AcceptsManyLandmarksTouchesAndInvalidNumbers) {
  std::mt19937 rng(kSeed);
  Session session(rng, 0.3, 0.3);
  DriftMonitor monitor;
  monitor.reset(session.registration_covariance());
  CheckTouch touch = session.touch(0);
  for (const int landmark : {-1, 15, 16, 1000}) {
    touch.landmark = landmark;
    monitor.add_check(touch);
  }
  EXPECT_EQ(monitor.checks(), 4);
  touch.residual_mm.x() = std::nan("");
  monitor.add_check(touch);
  EXPECT_EQ(monitor.checks(), 4);
  EXPECT_TRUE(std::isfinite(monitor.statistic()));
}

TEST(DriftMonitor, LimitHolds95PercentOfCleanTouches) {
  std::mt19937 rng(kSeed);
  int inside = 0;
  constexpr int kRuns = 4000;
  for (int i = 0; i < kRuns; ++i) {
    Session session(rng, 0.3, 0.3);
    DriftMonitor monitor;
    monitor.reset(session.registration_covariance());
    const CheckTouch touch = session.touch(i);
    inside += touch.residual_mm.norm() <= monitor.check_limit_95_mm(touch) ? 1 : 0;
  }
  EXPECT_NEAR(100.0 * inside / kRuns, 95.0, 1.2);
}

TEST(DriftMonitor, TouchesAndSurfaceDoNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  std::mt19937 rng(kSeed);
  Session session(rng, 0.3, 0.3);
  DriftMonitor monitor;
  const CheckTouch touch = session.touch(0);
  const test::AllocationScope scope;
  monitor.reset(session.registration_covariance());
  for (int i = 0; i < 40; ++i) {
    monitor.add_check(touch);
    monitor.add_surface_residual({3.0 * i, 20.0, 30.0}, 0.1, 0.7, Vector3d::UnitZ());
  }
  EXPECT_GT(monitor.check_limit_95_mm(touch), 0.0);
  EXPECT_EQ(scope.count(), 0U);
}

} // namespace
