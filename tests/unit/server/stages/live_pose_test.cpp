// The rule for live poses in the navigation pipeline: how long a pose lives, and that its age is paid for.
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "server/stages/wire_values.hpp"
#include "tests/unit/server/stages/strokes.hpp"
#include "tests/unit/server/stages/tracked_tool.hpp"

namespace bregma::server::tracking_test {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kFast_ns = 4 * kMs; // 250 Hz
constexpr std::int64_t kSlow_ns = 1'000'000'000 / 60;
const Vector3d kTip_mm(40.0, -30.0, 50.0);

TEST(LivePose, APoseIsStaleFromTheLimitOnAndLostAtTheDeadline) {
  TrackedTool tracked(kFast_ns);
  tracked.move_to(0, kTip_mm);
  EXPECT_EQ(tracked.stylus().valid_for_ns, 96 * kMs);
  tracked.pipeline.on_tick(kStart_ns + 100 * kMs - 1);
  EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_LIVE);
  EXPECT_EQ(tracked.stylus().valid_for_ns, 1);
  EXPECT_EQ(tracked.pipeline.next_change_ns(), kStart_ns + 100 * kMs) << "the stage wakes up for it";
  tracked.pipeline.on_tick(kStart_ns + 100 * kMs);
  EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_STALE);
  EXPECT_EQ(tracked.stylus().valid_for_ns, 0);
  EXPECT_TRUE(std::isnan(tracked.stylus().T_image_tip.translation_mm[0]));
  EXPECT_EQ(tracked.pipeline.next_change_ns(), kStart_ns + 204 * kMs);
  tracked.pipeline.on_tick(kStart_ns + 204 * kMs);
  EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_LOST);
}

TEST(LivePose, ASlowTrackerHasThreePeriodsButNeverMoreThan300Ms) {
  for (const auto &[period_ms, limit_ms] : {std::pair{50, 150}, {100, 300}, {1000, 300}}) {
    TrackedTool tracked(period_ms * kMs);
    tracked.move_to(0, kTip_mm);
    tracked.pipeline.on_tick(kStart_ns + limit_ms * kMs - 1);
    EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_LIVE) << period_ms;
    tracked.pipeline.on_tick(kStart_ns + limit_ms * kMs);
    EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_STALE) << period_ms << ": stale comes before lost";
  }
}

TEST(LivePose, AFrameThatArrivesTooLateIsNeverLive) {
  TrackedTool tracked(kFast_ns);
  tracked.take(tracked.frame(0, kTip_mm), kStart_ns, 101 * kMs);
  EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_STALE);
}

TEST(LivePose, AFrameThatSaysHiddenEndsThePoseAtOnce) {
  TrackedTool tracked(kFast_ns);
  tracked.move_to(0, kTip_mm);
  auto frame = tracked.frame(1, kTip_mm);
  TrackedTool::stylus_of(frame).status = bregma_wire_TOOL_HIDDEN;
  tracked.take(frame, tracked.acquired_ns(1));
  EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_TOOL_HIDDEN);
  frame = tracked.frame(2, kTip_mm);
  TrackedTool::reference_of(frame).status = 99; // a status of a later revision counts as not seen
  tracked.take(frame, tracked.acquired_ns(2));
  EXPECT_EQ(tracked.stylus().status, bregma_wire_POSE_REFERENCE_HIDDEN);
}

TEST(LivePose, TheAgeOfARepeatedPoseRunsFromItsFirstFrame) {
  for (const bool reference : {false, true}) {
    TrackedTool tracked(kFast_ns);
    auto frozen = tracked.frame(0, kTip_mm);
    std::uint64_t live = 0;
    for (std::uint64_t i = 0; i < 100; ++i) {
      auto frame = tracked.frame(i, kTip_mm);
      wire::TrackedTool &body = reference ? TrackedTool::reference_of(frame) : TrackedTool::stylus_of(frame);
      body = reference ? TrackedTool::reference_of(frozen) : TrackedTool::stylus_of(frozen);
      tracked.take(frame, tracked.acquired_ns(i));
      EXPECT_EQ(tracked.stylus().acquired_time_ns, kStart_ns);
      live += tracked.stylus().status == bregma_wire_POSE_LIVE ? 1 : 0;
    }
    EXPECT_EQ(live, 24U) << "frames that were published before the age of 100 ms: 4, 8 ... 96 ms";
    tracked.move_to(101, kTip_mm);
    EXPECT_EQ(tracked.stylus().acquired_time_ns, tracked.acquired_ns(101));
  }
}

// Measuring is stricter than showing.
TEST(LivePose, ATouchUsesNoFrameThatIsRepeatedOrOlderThanThreePeriods) {
  const auto status_of_touch = [](std::int64_t delay_ns, bool repeated) {
    TrackedTool tracked(kFast_ns);
    CaptureRequest request{};
    request.id = 1;
    (void)wire::set_name(request.tool, "Stylus");
    request.start_ns = kStart_ns;
    request.window_ns = 300 * kMs;
    request.max_motion_mm = 1.0;
    tracked.pipeline.handle(NavigationMessage(request));
    const auto first = tracked.frame(0, kTip_mm);
    for (std::uint64_t i = 0; i <= 80; ++i) {
      auto frame = repeated ? first : tracked.frame(i, kTip_mm);
      frame.frame = i;
      tracked.take(frame, tracked.acquired_ns(i), delay_ns);
    }
    NavigationEvent event;
    EXPECT_TRUE(tracked.events.try_pop(event));
    return std::get<CaptureResult>(event).status;
  };
  EXPECT_EQ(status_of_touch(16 * kMs, false), CaptureStatus::kOk);
  EXPECT_EQ(status_of_touch(17 * kMs, false), CaptureStatus::kNotNew);
  EXPECT_EQ(status_of_touch(4 * kMs, true), CaptureStatus::kImplausible) << "frozen for most of the window";
}

bool is_inside(const Matrix3d &covariance, const Vector3d &error) {
  return uncertainty::mahalanobis_squared(covariance, error) <= uncertainty::chi_square_upper_quantile(0.05, 3);
}

Matrix3d matrix_of(const double (&values)[9]) { return RowMajor<3>::Map(values); }

Matrix3d tip_covariance(const wire::NavigationState &state) {
  return uncertainty::tre_covariance(RowMajor<6>::Map(state.covariance),
                                     Vector3d::Map(state.T_image_tip.translation_mm));
}

TEST(LivePose, TheDistanceToAStructureErrsByTheTipAndByTheImageOfItsSegmentation) {
  casefile::Case a_case = tests::sample_case("/cases/sample");
  const auto sigma_mm = [](const casefile::Case &of) {
    TrackedTool tracked(kFast_ns, 1, {}, of);
    tracked.move_to(0, kTip_mm);
    EXPECT_EQ(wire::view(tracked.stylus().nearest_structure), of.structures.back().name);
    EXPECT_GT(tracked.stylus().nearest_structure_mm, 1.0);
    const Matrix3d P = tip_covariance(tracked.stylus());
    const Vector3d spread = P.eigenvalues().real().cwiseSqrt();
    const double sigma = tracked.stylus().nearest_structure_sigma_mm;
    tracked.pipeline.on_tick(kStart_ns + 300 * kMs);
    EXPECT_TRUE(std::isnan(tracked.stylus().nearest_structure_sigma_mm)) << "without a pose";
    if (of.images.empty()) {
      EXPECT_GE(sigma, spread.minCoeff() * (1.0 - 1e-9));
      EXPECT_LE(sigma, spread.maxCoeff() * (1.0 + 1e-9));
    }
    return sigma;
  };
  const double tip = sigma_mm(a_case);
  casefile::RegisteredImage image;
  image.name = "T2";
  image.verdict = "found";
  image.T_image_source.covariance.diagonal() << 0, 0, 0, 0.64, 0.64, 0.64; // the same at every point and direction
  put_image(a_case, image);
  a_case.structures.back().segmented_in = "T2";
  EXPECT_NEAR(sigma_mm(a_case), std::sqrt(tip * tip + 0.64), 1e-9);
}

struct Coverage {
  static constexpr std::array<std::int64_t, 4> kAge_ms{0, 25, 50, 100};
  std::array<int, 4> by_daemon{}, held{}, moved{};
  int count = 0;
};

// The daemon publishes at each age; or it publishes on arrival, and a display draws at each age, either by the stated
// growth alone or moving the tip by its velocity.
Coverage coverage(std::int64_t period_ns, double filter_hz, unsigned seed, double seconds) {
  NavigationParameters parameters;
  parameters.filter_hz = filter_hz;
  TrackedTool tracked(period_ns, seed, parameters);
  Strokes truth(seed);
  Strokes later(seed);
  Coverage out;
  const auto frames = static_cast<std::uint64_t>(seconds * 1e9 / static_cast<double>(period_ns));
  for (std::uint64_t i = 0; i < frames; ++i) {
    const std::int64_t acquired_ns = tracked.acquired_ns(i);
    const double time_s = 1e-9 * static_cast<double>(acquired_ns - kStart_ns);
    tracked.take(tracked.frame(i, truth.at(time_s)), acquired_ns, 0);
    if (i % 13 != 0 || i == 0) {
      continue;
    }
    ++out.count;
    const wire::NavigationState first = tracked.stylus();
    for (std::size_t k = 0; k < Coverage::kAge_ms.size(); ++k) {
      const std::int64_t age_ns = std::min(Coverage::kAge_ms[k] * kMs, 100 * kMs - 1);
      const double dt = 1e-9 * static_cast<double>(age_ns);
      Strokes copy = later;
      const Vector3d tip = copy.at(time_s + dt);
      tracked.pipeline.on_tick(acquired_ns + age_ns);
      const wire::NavigationState &state = tracked.stylus();
      EXPECT_EQ(state.status, bregma_wire_POSE_LIVE);
      out.by_daemon[k] += is_inside(tip_covariance(state), tip - Vector3d::Map(state.T_image_tip.translation_mm));
      const Vector3d shown = Vector3d::Map(first.T_image_tip.translation_mm);
      const Vector3d v = Vector3d::Map(first.velocity_mm_s);
      const Matrix3d C = matrix_of(first.position_velocity_covariance_mm2_s);
      const Matrix3d V = matrix_of(first.velocity_covariance_mm2_s2);
      const double path = 0.5 * dt * dt * first.acceleration_sigma_mm_s2;
      const Matrix3d held =
          tip_covariance(first) + dt * (C + C.transpose()) + dt * dt * V + path * path * Matrix3d::Identity();
      out.held[k] += is_inside(held, tip - shown);
      out.moved[k] += is_inside(held - dt * dt * v * v.transpose(), tip - shown - dt * v);
    }
    (void)later.at(time_s);
  }
  return out;
}

TEST(LivePose, TheTrueTipLiesInTheDrawnRegionAtEveryAge) {
  for (const std::int64_t period_ns : {kFast_ns, kSlow_ns}) {
    for (const double filter_hz : {3.0, 0.0}) {
      Coverage all;
      for (unsigned seed = 1; seed <= 20; ++seed) {
        const Coverage one = coverage(period_ns, filter_hz, seed, 30.0);
        all.count += one.count;
        for (std::size_t k = 0; k < 4; ++k) {
          all.by_daemon[k] += one.by_daemon[k];
          all.held[k] += one.held[k];
          all.moved[k] += one.moved[k];
        }
      }
      for (std::size_t k = 0; k < 4; ++k) {
        const auto share = [&](int inside) { return static_cast<double>(inside) / all.count; };
        const std::string where =
            "period " + std::to_string(period_ns / kMs) + " ms, filter " + std::to_string(filter_hz) + " Hz, age " +
            std::to_string(Coverage::kAge_ms[k]) + " ms: " + std::to_string(share(all.by_daemon[k])) + " published, " +
            std::to_string(share(all.held[k])) + " held, " + std::to_string(share(all.moved[k])) + " moved";
        std::printf("%s\n", where.c_str());
        EXPECT_GE(share(all.by_daemon[k]), 0.93) << where;
        EXPECT_GE(share(all.held[k]), 0.93) << where;
        EXPECT_GE(share(all.moved[k]), 0.93) << where;
      }
    }
  }
}

} // namespace
} // namespace bregma::server::tracking_test
