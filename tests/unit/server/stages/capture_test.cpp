#include "server/stages/navigation/capture.hpp"

#include <random>

#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace {

using namespace bregma;
using namespace bregma::server;
using geometry::Matrix3d;
using geometry::Vector3d;

constexpr unsigned kCaptureSeed = 3;
constexpr std::int64_t kStart_ns = 1'000'000'000;
constexpr std::int64_t kWindow_ns = 300'000'000;
constexpr std::int64_t kFrame_ns = 4'000'000;

CaptureRequest request() {
  CaptureRequest out{};
  out.id = 5;
  (void)wire::set_name(out.tool, "Stylus");
  out.start_ns = kStart_ns;
  out.window_ns = kWindow_ns;
  out.max_motion_mm = 1.0;
  return out;
}

TipInReference tip_at(const Vector3d &position) {
  return {position, Matrix3d::Identity() * 0.25, Matrix3d::Identity() * 0.01, Matrix3d::Zero()};
}

// All frames of the window; content and position by frame number.
template <class Content, class Position> std::optional<CaptureResult> capture(Content content, Position position) {
  TouchCapture touch;
  touch.start(request());
  std::int64_t now_ns = kStart_ns;
  for (std::uint64_t i = 0; now_ns <= kStart_ns + kWindow_ns; ++i, now_ns += kFrame_ns) {
    touch.add(content(i), tip_at(position(i)), i, now_ns);
    EXPECT_FALSE(touch.finish(now_ns).has_value()) << "answered before the window was over";
  }
  const auto result = touch.finish(now_ns);
  EXPECT_FALSE(touch.finish(now_ns + 1).has_value()) << "answered twice";
  return result;
}

const auto kSeen = [](std::uint64_t) { return FrameContent::kTip; };

TEST(TouchCapture, AveragesTheMarkersNoiseAndKeepsTheErrorOfTheTip) {
  std::mt19937 rng(kCaptureSeed);
  std::normal_distribution<double> normal(0.0, 0.5);
  const auto result =
      capture(kSeen, [&](std::uint64_t) { return Vector3d(10 + normal(rng), normal(rng), normal(rng)); });
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->status, CaptureStatus::kOk) << result->motion_mm;
  EXPECT_EQ(result->id, 5U);
  EXPECT_NEAR(result->position_mm[0], 10.0, 0.25);
  EXPECT_NEAR(result->covariance_mm2[0], 0.25 / result->used_frames + 0.01, 1e-12);
  EXPECT_EQ(result->used_frames, result->window_frames);
}

TEST(TouchCapture, AMovedTipWasNotHeldStill) {
  const auto result = capture(kSeen, [](std::uint64_t i) { return Vector3d(0.08 * static_cast<double>(i), 0, 0); });
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->status, CaptureStatus::kMoved);
  EXPECT_GT(result->motion_mm, 1.0);
}

TEST(TouchCapture, ReportsWhetherToolOrReferenceWasHidden) {
  const auto nowhere = [](std::uint64_t) { return Vector3d(0, 0, 0); };
  const auto mostly = [](FrameContent hidden) {
    return [hidden](std::uint64_t i) { return i % 3 == 0 ? FrameContent::kTip : hidden; };
  };
  EXPECT_EQ(capture(mostly(FrameContent::kToolHidden), nowhere)->status, CaptureStatus::kToolHidden);
  EXPECT_EQ(capture(mostly(FrameContent::kReferenceHidden), nowhere)->status, CaptureStatus::kReferenceHidden);
  EXPECT_EQ(capture([](auto) { return FrameContent::kNotCalibrated; }, nowhere)->status, CaptureStatus::kNotCalibrated);
}

TEST(TouchCapture, ASilentTrackerIsReported) {
  TouchCapture touch;
  touch.start(request());
  const auto result = touch.finish(kStart_ns + kWindow_ns + 1);
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->status, CaptureStatus::kNoFrames);
}

TEST(SurfaceTrace, TakesASampleWhenTheTipHasMovedByTheSpacing) {
  SurfaceTrace trace;
  TraceRequest on{};
  (void)wire::set_name(on.tool, "Stylus");
  on.on = true;
  on.spacing_mm = 3.0;
  trace.request(on);
  EXPECT_TRUE(trace.on(on.tool));
  int samples = 0;
  for (int i = 0; i <= 300; ++i) {
    samples += trace.add(tip_at({0.125 * i, 0, 0}), 1, 1).has_value() ? 1 : 0;
  }
  EXPECT_EQ(samples, 13);
}

} // namespace
