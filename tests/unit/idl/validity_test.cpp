// The client's half of the rule for live poses, with clocks that the tests set.
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "idl/boot_clock.hpp"
#include "idl/names.hpp"
#include "idl/validity.hpp"

namespace {

using namespace bregma;
using wire::Arrival;
using wire::kMillisecond_ns;
using wire::TransitClock;

constexpr std::int64_t kSecond_ns = 1'000 * kMillisecond_ns;
constexpr std::array<std::uint8_t, 16> kHere{1};
constexpr wire::BootId kSameBoot = {1};
constexpr wire::BootId kOtherBoot = {2};

wire::NavigationState live_pose(std::int64_t age_ns, std::int64_t valid_for_ns) {
  wire::NavigationState state{};
  state.status = bregma_wire_POSE_LIVE;
  state.acquired_time_ns = 1;
  state.age_ns = age_ns;
  state.valid_for_ns = valid_for_ns;
  state.T_image_tip = {{1, 0, 0, 0}, {1, 2, 3}};
  state.tre_rms_mm = 0.7;
  state.acceleration_sigma_mm_s2 = wire::kUnknown;
  return state;
}

Arrival arrived(TransitClock &clock, const wire::BootId &boot, std::int64_t published_ns, std::int64_t arrival_ns) {
  return {arrival_ns, clock.arrived(boot, published_ns, arrival_ns)};
}

TEST(LiveLimit, IsTheLargerOfLimitAndThreePeriodsAndNeverAbove300ms) {
  EXPECT_EQ(wire::live_limit_ns(100.0, 0), 100 * kMillisecond_ns);
  EXPECT_EQ(wire::live_limit_ns(100.0, 16'666'667), 100 * kMillisecond_ns);
  EXPECT_EQ(wire::live_limit_ns(20.0, 16'666'667), 50'000'001);
  EXPECT_EQ(wire::live_limit_ns(100.0, 50 * kMillisecond_ns), 150 * kMillisecond_ns);
  EXPECT_EQ(wire::live_limit_ns(200.0, kSecond_ns), 300 * kMillisecond_ns);
  EXPECT_EQ(wire::live_limit_ns(100.0, std::numeric_limits<std::int64_t>::max()), 300 * kMillisecond_ns);
  EXPECT_EQ(wire::live_limit_ns(100.0, -kSecond_ns), 100 * kMillisecond_ns);
  EXPECT_EQ(wire::live_limit_ns(5.0, 0), 20 * kMillisecond_ns) << "the limit's own range";
  EXPECT_EQ(wire::live_limit_ns(1e9, 0), 200 * kMillisecond_ns);
}

TEST(BootClock, IsThisBootsAndNeverGoesBack) {
  const auto first = wire::boot_now_ns();
  EXPECT_GT(first, 0);
  EXPECT_GE(wire::boot_now_ns(), first);
  EXPECT_NE(wire::boot_id(), (std::array<std::uint8_t, 16>{}));
  EXPECT_EQ(wire::boot_id(), wire::boot_id());
}

TEST(Validity, OnOneHostThePoseEndsExactlyWhenItsTimeIsOver) {
  TransitClock clock(kHere);
  const auto state = live_pose(20 * kMillisecond_ns, 80 * kMillisecond_ns);
  const std::int64_t published = 5 * kSecond_ns;
  const auto arrival = arrived(clock, kSameBoot, published, published + 3 * kMillisecond_ns);
  EXPECT_EQ(wire::remaining_ns(state, arrival, arrival.boot_ns), 77 * kMillisecond_ns);
  EXPECT_EQ(wire::age_ns(state, arrival, arrival.boot_ns), 23 * kMillisecond_ns);
  EXPECT_EQ(wire::remaining_ns(state, arrival, published + 80 * kMillisecond_ns - 1), 1);
  EXPECT_EQ(wire::remaining_ns(state, arrival, published + 80 * kMillisecond_ns), 0);
  EXPECT_EQ(wire::remaining_ns(state, arrival, published + 3600 * kSecond_ns), 0) << "suspended for an hour";
}

TEST(Validity, NoPublisherCanExtendAPoseBeyond300msOfAge) {
  TransitClock clock(kHere);
  const auto state = live_pose(50 * kMillisecond_ns, std::numeric_limits<std::int64_t>::max());
  const auto arrival = arrived(clock, kSameBoot, kSecond_ns, kSecond_ns);
  EXPECT_EQ(wire::remaining_ns(state, arrival, kSecond_ns), 250 * kMillisecond_ns);
}

TEST(Validity, ADaemonThatStatesNoValidityCountsWithTheDefaultLimit) {
  TransitClock clock(kHere);
  const auto arrival = arrived(clock, kSameBoot, kSecond_ns, kSecond_ns);
  EXPECT_EQ(wire::remaining_ns(live_pose(30 * kMillisecond_ns, 0), arrival, kSecond_ns), 70 * kMillisecond_ns);
  EXPECT_EQ(wire::remaining_ns(live_pose(120 * kMillisecond_ns, 0), arrival, kSecond_ns), 0);
}

TEST(Validity, WhatIsNotKnownIsNeverShown) {
  TransitClock clock(kHere);
  const std::int64_t now = 5 * kSecond_ns;
  const auto good = arrived(clock, kSameBoot, now, now);
  const auto shown = [&](const wire::NavigationState &state, const Arrival &arrival, std::int64_t at) {
    return wire::remaining_ns(state, arrival, at) > 0;
  };
  const auto pose = live_pose(10 * kMillisecond_ns, 90 * kMillisecond_ns);
  ASSERT_TRUE(shown(pose, good, now));
  EXPECT_FALSE(shown(pose, good, now - 1)) << "before its arrival";
  EXPECT_FALSE(shown(pose, arrived(clock, kSameBoot, now + 1, now), now)) << "published in the future";
  EXPECT_FALSE(shown(pose, arrived(clock, kSameBoot, 0, now), now)) << "no publication time";
  EXPECT_FALSE(shown(pose, arrived(clock, {}, now, now), now)) << "no boot id";
  for (const auto time : {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()}) {
    EXPECT_FALSE(shown(pose, arrived(clock, kSameBoot, time, now), now));
    auto strange = pose;
    strange.age_ns = time;
    EXPECT_FALSE(shown(strange, good, now));
  }
  auto future = pose;
  future.age_ns = -1;
  EXPECT_FALSE(shown(future, good, now)) << "a negative age is never fresh";
  auto ended = pose;
  ended.valid_for_ns = std::numeric_limits<std::int64_t>::min();
  EXPECT_FALSE(shown(ended, good, now));
  auto unknown = pose;
  unknown.T_image_tip.translation_mm[1] = wire::kUnknown;
  EXPECT_FALSE(shown(unknown, good, now));
  unknown = pose;
  unknown.tre_rms_mm = wire::kUnknown;
  EXPECT_FALSE(shown(unknown, good, now)) << "a pose without its error";
  for (const int plausibility : {-1, 3, 4}) {
    auto refused = pose;
    refused.plausibility = plausibility;
    EXPECT_FALSE(shown(refused, good, now)) << plausibility;
  }
  for (int status = -1; status <= 20; ++status) {
    auto other = pose;
    other.status = status;
    EXPECT_EQ(shown(other, good, now), status == bregma_wire_POSE_LIVE || status == bregma_wire_POSE_UNVERIFIED);
  }
}

// A publisher on another host: its clock differs by offset and drifts; frames every 10 ms.
class OtherHost {
public:
  explicit OtherHost(std::int64_t offset_ns, double drift = 0.0) : offset_ns_(offset_ns), drift_(drift) {}
  // One sample of the pose, published at `at` and received delay later, by this host's clock.
  Arrival sample(std::int64_t at, std::int64_t delay_ns) {
    const auto published = at + offset_ns_ + static_cast<std::int64_t>(drift_ * static_cast<double>(at));
    return arrived(clock_, kOtherBoot, published, at + delay_ns);
  }
  // Publishes from .. to, each with the shortest delay.
  void run(std::int64_t from, std::int64_t to) {
    for (std::int64_t at = from; at < to; at += 10 * kMillisecond_ns) {
      (void)sample(at, kMillisecond_ns);
    }
  }

private:
  TransitClock clock_{kHere};
  std::int64_t offset_ns_;
  double drift_;
};

constexpr std::int64_t kStart = 100 * kSecond_ns;

TEST(Validity, FromAnotherHostTheDelayAboveTheShortestOneIsCounted) {
  for (const std::int64_t offset : {-50 * kSecond_ns, std::int64_t{0}, 86'400 * kSecond_ns}) {
    OtherHost host(offset);
    host.run(kStart, kStart + kSecond_ns);
    const auto pose = live_pose(20 * kMillisecond_ns, 80 * kMillisecond_ns);
    const auto prompt = host.sample(kStart + kSecond_ns, kMillisecond_ns);
    EXPECT_NEAR(static_cast<double>(*prompt.transit_ns), 0.0, 2e3);
    EXPECT_NEAR(static_cast<double>(wire::remaining_ns(pose, prompt, prompt.boot_ns)), 80e6, 1e4);
    const auto delayed = host.sample(kStart + kSecond_ns, 61 * kMillisecond_ns);
    EXPECT_NEAR(static_cast<double>(wire::remaining_ns(pose, delayed, delayed.boot_ns)), 20e6, 1e4);
    const auto late = host.sample(kStart + kSecond_ns, 90 * kMillisecond_ns);
    EXPECT_EQ(wire::remaining_ns(pose, late, late.boot_ns), 0);
  }
}

TEST(Validity, AHistoricSampleReceivedAtJoiningIsNotShown) {
  OtherHost host(7 * kSecond_ns);
  const auto pose = live_pose(10 * kMillisecond_ns, 90 * kMillisecond_ns);
  // Two tools' last samples, an hour old, and then nothing.
  for (int tool = 0; tool < 2; ++tool) {
    const auto old = host.sample(kStart, 3600 * kSecond_ns + tool * kMillisecond_ns);
    EXPECT_EQ(wire::remaining_ns(pose, old, old.boot_ns), 0);
  }
  // A publisher that speaks is shown after the settling time.
  const std::int64_t live = kStart + 3600 * kSecond_ns + 5 * kMillisecond_ns;
  host.run(live, live + TransitClock::kSettling_ns);
  const auto fresh = host.sample(live + TransitClock::kSettling_ns, kMillisecond_ns);
  EXPECT_GT(wire::remaining_ns(pose, fresh, fresh.boot_ns), 89 * kMillisecond_ns);
}

TEST(Validity, WhatWasQueuedWhileTheClientWasStoppedIsNotShown) {
  const auto pose = live_pose(10 * kMillisecond_ns, 90 * kMillisecond_ns);
  for (const std::int64_t joined_for : {100 * kMillisecond_ns, 10 * kSecond_ns}) { // stopped while settling, and later
    OtherHost host(-3 * kSecond_ns);
    host.run(kStart, kStart + joined_for);
    const std::int64_t wakes = kStart + joined_for + 3 * kSecond_ns;
    for (std::int64_t i = 0; i < 100; ++i) { // the socket's queue: the second after the stop, delivered within 5 ms
      const std::int64_t published = kStart + joined_for + i * 10 * kMillisecond_ns;
      const auto queued = host.sample(published, wakes - published + i * 50'000);
      EXPECT_EQ(wire::remaining_ns(pose, queued, queued.boot_ns), 0) << joined_for << " " << i;
    }
  }
}

TEST(Validity, GrowingDelaysAreSeenAndClockDriftIsNoDelay) {
  for (const double ramp_ms_s : {1.0, 10.0}) {
    OtherHost host(0);
    host.run(kStart, kStart + 10 * kSecond_ns);
    for (int second = 0; second < 100; ++second) {
      const double true_ms = 1.0 + ramp_ms_s * second;
      const auto sample = host.sample(kStart + (10 + second) * kSecond_ns, static_cast<std::int64_t>(true_ms * 1e6));
      ASSERT_TRUE(sample.transit_ns);
      EXPECT_GE(static_cast<double>(*sample.transit_ns) * 1e-6, 0.88 * (true_ms - 1.0) - 1.5);
    }
  }
  for (const double drift : {-50e-6, 50e-6}) { // an hour
    OtherHost host(0, drift);
    std::int64_t largest = 0;
    for (std::int64_t at = kStart; at < kStart + 3600 * kSecond_ns; at += 20 * kMillisecond_ns) {
      largest = std::max(largest, host.sample(at, kMillisecond_ns).transit_ns.value_or(0));
    }
    EXPECT_LT(largest, kMillisecond_ns) << drift;
  }
}

TEST(Validity, AfterARestartOfThePublishersHostTheEnvelopeBeginsAgain) {
  TransitClock clock(kHere);
  for (std::int64_t at = kStart; at < kStart + kSecond_ns; at += 10 * kMillisecond_ns) {
    (void)clock.arrived(kOtherBoot, at, at);
  }
  const wire::BootId rebooted = {3};
  EXPECT_FALSE(clock.arrived(rebooted, kSecond_ns, kStart + 2 * kSecond_ns));
}

Eigen::Matrix3d covariance_of(const wire::Ellipsoid &region) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> axes(region.axes);
  const Eigen::Vector3d variance = Eigen::Map<const Eigen::Vector3d>(region.semi_axes_mm).cwiseAbs2() / 7.814727903;
  return axes.transpose() * variance.asDiagonal() * axes;
}

TEST(TipError, GrowsWithTheTimeSincePublication) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const auto matrix = [&] { return Eigen::Matrix3d::NullaryExpr([&] { return normal(random); }).eval(); };
  auto state = live_pose(0, kMillisecond_ns);
  const Eigen::Matrix3d A = matrix();
  const Eigen::Matrix3d P = A * A.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(P);
  for (int i = 0; i < 3; ++i) {
    state.tre_95.semi_axes_mm[i] = std::sqrt(7.814727903251179 * solver.eigenvalues()[2 - i]);
    Eigen::Map<Eigen::Vector3d>(state.tre_95.axes + 3 * static_cast<std::ptrdiff_t>(i)) =
        solver.eigenvectors().col(2 - i);
  }
  state.tre_rms_mm = std::sqrt(P.trace());
  const auto unchanged = wire::tip_error(state, 100 * kMillisecond_ns);
  EXPECT_EQ(unchanged.rms_mm, std::sqrt(P.trace())) << "without a stated growth";

  const Eigen::Matrix3d C = 5.0 * matrix();
  const Eigen::Matrix3d B = 50.0 * matrix();
  const Eigen::Matrix3d V = B * B.transpose();
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(state.position_velocity_covariance_mm2_s) = C;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(state.velocity_covariance_mm2_s2) = V;
  state.acceleration_sigma_mm_s2 = 2'000.0;
  const double dt = 0.1;
  const Eigen::Matrix3d expected =
      P + dt * (C + C.transpose()) + dt * dt * V + std::pow(dt, 4) / 4.0 * 4e6 * Eigen::Matrix3d::Identity();
  const auto grown = wire::tip_error(state, 100 * kMillisecond_ns);
  EXPECT_TRUE(covariance_of(grown.region_95).isApprox(expected, 1e-9)) << covariance_of(grown.region_95);
  EXPECT_NEAR(grown.rms_mm, std::sqrt(expected.trace()), 1e-9);
  EXPECT_GE(grown.region_95.semi_axes_mm[0], grown.region_95.semi_axes_mm[1]);
  EXPECT_GE(grown.region_95.semi_axes_mm[1], grown.region_95.semi_axes_mm[2]);
}

} // namespace
