// Faulty data of a tracker in the navigation pipeline: nothing of them is shown as live, for 20 seeds per fault, while
// a hand moves at up to 0.5 m/s.
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "server/stages/wire_values.hpp"
#include "tests/unit/server/stages/strokes.hpp"
#include "tests/unit/server/stages/tracked_tool.hpp"

namespace bregma::server::tracking_test {
namespace {

constexpr unsigned kSeeds = 20;
constexpr std::int64_t kLimit_ns = 100'000'000;
constexpr double kExpectedResidual_mm = 0.2031; // of four markers

using Body = wire::TrackedTool;

// Reflection in the plane x = 0 of the tracker, as by a left-handed driver.
void mirror(Body &body) {
  body.T_tracker_tool.translation_mm[0] *= -1.0;
  body.T_tracker_tool.rotation_wxyz[2] *= -1.0;
  body.T_tracker_tool.rotation_wxyz[3] *= -1.0;
}
void transpose(Body &body) {
  for (int i = 1; i < 4; ++i) {
    body.T_tracker_tool.rotation_wxyz[i] *= -1.0;
  }
}
void to_metres(Body &body) {
  for (double &coordinate : body.T_tracker_tool.translation_mm) {
    coordinate *= 1e-3;
  }
}
void jump(Body &body) { body.T_tracker_tool.translation_mm[1] += 100.0; }

enum class Of { kTool, kReference, kBoth };

struct Fault {
  const char *name;
  Of of;
  bool at_once; // malformed: not live from the first frame on
  wire::PlausibilityReason reason;
  std::function<void(Body &)> spoil; // empty: repeats the first frame of the fault
};

std::vector<Fault> faults() {
  constexpr auto kFrozen = bregma_wire_IMPLAUSIBLE_FROZEN;
  constexpr auto kMarkers = bregma_wire_IMPLAUSIBLE_MARKERS;
  constexpr auto kResidual = bregma_wire_IMPLAUSIBLE_RESIDUAL;
  constexpr auto kJump = bregma_wire_IMPLAUSIBLE_JUMP;
  constexpr auto kRotation = bregma_wire_IMPLAUSIBLE_ROTATION;
  constexpr auto kVolume = bregma_wire_IMPLAUSIBLE_VOLUME;
  const auto partly = [](std::uint32_t used) {
    return [used](Body &body) {
      body.status = bregma_wire_TOOL_PARTLY_VISIBLE;
      body.used_markers = used;
    };
  };
  const auto residual = [](double mm) { return [mm](Body &body) { body.marker_rms_mm = mm; }; };
  return {{"the tool's bytes repeat", Of::kTool, false, kFrozen, {}},
          {"the reference's bytes repeat", Of::kReference, false, kFrozen, {}},
          {"all bytes repeat", Of::kBoth, false, kFrozen, {}},
          {"residual of 3.01 times the expected", Of::kTool, false, kResidual, residual(3.01 * kExpectedResidual_mm)},
          {"the reference's residual of 3.01 times", Of::kReference, false, kResidual,
           residual(3.01 * kExpectedResidual_mm)},
          {"residual of 50 mm", Of::kTool, true, kResidual, residual(50.0)},
          {"two markers", Of::kTool, true, kMarkers, partly(0b0101)},
          {"two markers of the reference", Of::kReference, true, kMarkers, partly(0b0101)},
          {"no marker", Of::kTool, true, kMarkers, partly(0)},
          {"a fifth of four markers", Of::kTool, true, kMarkers, partly(0b10111)},
          {"visible with three of four", Of::kTool, true, kMarkers, [](Body &body) { body.used_markers = 0b0111; }},
          {"partly visible with all", Of::kTool, true, kMarkers, partly(0b1111)},
          {"mirrored tool", Of::kTool, false, kRotation, mirror},
          {"mirrored tracker", Of::kBoth, false, kRotation, mirror},
          {"transposed tool", Of::kTool, false, kRotation, transpose},
          {"transposed tracker", Of::kBoth, false, kRotation, transpose},
          {"tool in metres", Of::kTool, false, kVolume, to_metres},
          {"tracker in metres", Of::kBoth, false, kVolume, to_metres},
          {"tool jumps", Of::kTool, false, kJump, jump},
          {"reference jumps", Of::kReference, false, kJump, jump}};
}

class TrackerFault : public testing::TestWithParam<std::tuple<std::size_t, std::int64_t>> {
protected:
  // Live states that must not be; 0 if the seed is good.
  int live_states(const Fault &fault, std::int64_t period_ns, unsigned seed) {
    TrackedTool tracked(period_ns, seed);
    Strokes hand(seed);
    const auto begin = static_cast<std::uint64_t>(1'000'000'000 / period_ns);
    const auto end = 3 * begin;
    std::optional<wire::TrackerFrame> first;
    std::optional<wire::PlausibilityReason> reason;
    int wrong = 0;
    const auto tip_at = [&](std::uint64_t i) {
      return hand.at(1e-9 * static_cast<double>(period_ns) * static_cast<double>(i));
    };
    for (std::uint64_t i = 0; i < end; ++i) {
      auto frame = tracked.frame(i, tip_at(i));
      if (i >= begin) {
        first = first.value_or(frame);
        for (const bool reference : {true, false}) {
          if ((reference && fault.of != Of::kTool) || (!reference && fault.of != Of::kReference)) {
            Body &body = frame.tools[reference ? 0 : 1];
            fault.spoil ? fault.spoil(body) : void(body = first->tools[reference ? 0 : 1]);
          }
        }
      }
      tracked.take(frame, tracked.acquired_ns(i));
      const std::int64_t faulty_ns = tracked.stylus().published_time_ns - tracked.acquired_ns(begin);
      const bool must_end = i >= begin && (fault.at_once || faulty_ns > kLimit_ns);
      wrong += must_end && tracked.has_pose() ? 1 : 0;
      if (tracked.stylus().plausibility == bregma_wire_PLAUSIBILITY_REFUSED) {
        EXPECT_GE(i, begin) << fault.name << ", seed " << seed << ": refused before the fault";
        reason = reason.value_or(tracked.stylus().plausibility_reason);
      }
    }
    EXPECT_EQ(reason.value_or(bregma_wire_IMPLAUSIBLE_UNKNOWN), fault.reason) << fault.name << ", seed " << seed;
    wrong += expect_recovery(fault, tracked, tip_at, end) ? 0 : 1;
    return wrong;
  }

  // A tool recovers by itself, also after more than a second; a reference only by a check touch.
  template <class Tip>
  static bool expect_recovery(const Fault &fault, TrackedTool &tracked, const Tip &tip_at, std::uint64_t begin) {
    const bool needs_touch = fault.of != Of::kTool && fault.reason != bregma_wire_IMPLAUSIBLE_MARKERS;
    const auto frames = [&](std::uint64_t from, std::uint64_t count) {
      for (std::uint64_t i = from; i < from + count; ++i) {
        tracked.move_to(i, tip_at(i));
      }
      return from + count;
    };
    std::uint64_t i = frames(begin, 20);
    if (needs_touch) {
      if (tracked.has_pose()) {
        return false;
      }
      TrackingConfirmed confirmed{};
      (void)wire::set_name(confirmed.tool, "Stylus");
      tracked.pipeline.handle(NavigationMessage(confirmed));
      i = frames(i, 1);
    }
    return tracked.has_pose();
  }
};

TEST_P(TrackerFault, IsNotShownAndRecovers) {
  const auto &[index, period_ns] = GetParam();
  const Fault fault = faults()[index];
  unsigned good = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const int wrong = live_states(fault, period_ns, seed);
    EXPECT_EQ(wrong, 0) << fault.name << ", seed " << seed;
    good += wrong == 0 ? 1 : 0;
  }
  std::printf("%s, period %lld ms: %u of %u seeds\n", fault.name, static_cast<long long>(period_ns / 1'000'000), good,
              kSeeds);
}

INSTANTIATE_TEST_SUITE_P(All, TrackerFault,
                         testing::Combine(testing::Range<std::size_t>(0, faults().size()),
                                          testing::Values(std::int64_t{4'000'000}, std::int64_t{16'666'667})));

bool is_finite(const wire::NavigationState &state) {
  const auto finite = [](const auto &values) {
    return Eigen::Map<const Eigen::ArrayXd>(values, std::ssize(values)).allFinite();
  };
  return finite(state.T_image_tip.rotation_wxyz) && finite(state.T_image_tip.translation_mm) &&
         finite(state.velocity_mm_s) && finite(state.covariance) && std::isfinite(state.tre_rms_mm) &&
         finite(state.tre_95.semi_axes_mm) && finite(state.tre_95.axes) &&
         finite(state.position_velocity_covariance_mm2_s) && finite(state.velocity_covariance_mm2_s2);
}

// Random faults of every field, behind the input check.
TEST(TrackerFaults, AMillionStatesHaveNoPoseThatIsNotFinite) {
  constexpr std::uint64_t kStates = 1'000'000;
  constexpr std::int64_t kPeriod_ns = 4'000'000;
  TrackedTool tracked(kPeriod_ns, 3);
  std::mt19937 rng(17);
  const auto chance = [&rng](double p) { return std::uniform_real_distribution<double>(0.0, 1.0)(rng) < p; };
  const auto any_number = [&rng] {
    constexpr double kInf = std::numeric_limits<double>::infinity();
    const double values[] = {0.0, -1.0, 1e-300, 1e300, kInf, -kInf, std::nan(""), 19'999.0, 1.0};
    return values[rng() % std::size(values)];
  };
  const inputs::KnownTools known;
  std::uint64_t states = 0, live = 0, bad = 0;
  wire::TrackerFrame before = tracked.frame(0, Vector3d::Zero());
  for (std::uint64_t i = 0; states < kStates; ++i) {
    // A few noisy frames, used again and again with a changed last digit: their fits would dominate the test.
    wire::TrackerFrame frame =
        i % 50 == 0 ? tracked.frame(i, Vector3d(40.0 * std::sin(0.001 * static_cast<double>(i)), 0, 0)) : before;
    before = frame;
    for (std::uint32_t t = 0; t < 2; ++t) {
      Body &body = frame.tools[t];
      body.T_tracker_tool.translation_mm[0] += 1e-6 * static_cast<double>(i % 50);
      if (chance(0.985)) {
        continue;
      }
      switch (rng() % 7) {
      case 0:
        body.used_markers = static_cast<std::uint32_t>(rng()) & (chance(0.5) ? 0xFU : ~0U);
        break;
      case 1:
        body.status = static_cast<wire::ToolStatus>(rng() % 6);
        break;
      case 2:
        body.marker_rms_mm = any_number();
        break;
      case 3:
        body.T_tracker_tool.translation_mm[rng() % 3] = any_number();
        break;
      case 4:
        body.T_tracker_tool.rotation_wxyz[rng() % 4] = any_number();
        break;
      case 5:
        body.covariance[rng() % 21] = static_cast<float>(any_number());
        break;
      default:
        jump(body);
      }
    }
    if (!inputs::check_payload(frame, known)) {
      tracked.take(frame, tracked.acquired_ns(i));
    }
    tracked.pipeline.on_tick(tracked.acquired_ns(i) + 5'000'000);
    if (chance(0.3)) { // a check touch, so that a refused reference does not end the test
      TrackingConfirmed confirmed{};
      (void)wire::set_name(confirmed.tool, "Stylus");
      tracked.pipeline.handle(NavigationMessage(confirmed));
    }
    for (const wire::NavigationState &state : tracked.pipeline.states()) {
      ++states;
      const bool shown = state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED;
      live += shown ? 1 : 0;
      bad += shown && !is_finite(state) ? 1 : 0;
      bad += !shown && !std::isnan(state.T_image_tip.translation_mm[0]) ? 1 : 0;
    }
  }
  EXPECT_EQ(bad, 0U);
  EXPECT_GT(live, kStates / 20);
  std::printf("%llu states, %llu live, %llu not finite\n", static_cast<unsigned long long>(states),
              static_cast<unsigned long long>(live), static_cast<unsigned long long>(bad));
}

} // namespace
} // namespace bregma::server::tracking_test
