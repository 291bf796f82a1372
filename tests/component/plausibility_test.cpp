// Plausibility of tracker data in complete operations in virtual time: no false alarm in clean ones, and alarms that
// name tool and reason. BREGMA_SEEDS sets the number of clean operations (5; the record in docs/navigation.md is of
// 100).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "server/session/messages.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

constexpr double kMinLiveFraction = 0.99;
constexpr std::int64_t kLimit_ns = 100'000'000;
constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::uint64_t seeds() {
  const char *text = std::getenv("BREGMA_SEEDS");
  return text != nullptr ? std::strtoull(text, nullptr, 10) : 5;
}

const wire::TrackedTool *find(const wire::TrackerFrame &frame, const std::string &tool) {
  const auto *end = frame.tools + frame.tool_count;
  const auto *found = std::find_if(frame.tools, end, [&](const auto &seen) { return wire::view(seen.tool) == tool; });
  return found != end ? found : nullptr;
}

bool is_seen(const wire::TrackerFrame &frame, const std::string &tool) {
  const wire::TrackedTool *seen = find(frame, tool);
  return seen != nullptr &&
         (seen->status == bregma_wire_TOOL_VISIBLE || seen->status == bregma_wire_TOOL_PARTLY_VISIBLE);
}

const wire::Alarm *raised(const VirtualOperation &operation, const char *kind) {
  const auto found = std::find_if(operation.alarms().begin(), operation.alarms().end(), [kind](const auto &alarm) {
    return wire::view(alarm.kind) == kind && alarm.state == bregma_wire_ALARM_RAISED;
  });
  return found != operation.alarms().end() ? &*found : nullptr;
}

// Delivers what the room sends at once, with changed tracker frames.
class SpoilingLine final : public Line {
public:
  explicit SpoilingLine(std::function<void(wire::TrackerFrame &)> spoil) : spoil_(std::move(spoil)) {}

  void carry(const sim::RoomOutput &sent, std::int64_t /*now_ns*/, MemoryTopics &to) override {
    const auto put = [&to](const auto &samples) {
      for (const auto &sample : samples) {
        to.put(sample);
      }
    };
    for (wire::TrackerFrame frame : sent.frames) {
      spoil_(frame);
      to.put(frame);
    }
    put(sent.robot_states);
    put(sent.range_samples);
    put(sent.force_samples);
    put(sent.commands);
  }
  [[nodiscard]] std::int64_t next_due_ns() const override { return server::Stage::kNever; }

private:
  std::function<void(wire::TrackerFrame &)> spoil_;
};

TEST(Plausibility, CleanOperationsAreLiveAndRaiseNoAlarm) {
  const CaseFolder folder;
  const sim::Scenario scenario = scenario_of(kRegisterSteps + kNavigateSteps);
  double least = 1.0;
  std::uint64_t frames = 0;
  std::uint64_t refused = 0;
  for (std::uint64_t seed = 1; seed <= seeds() + refused; ++seed) {
    VirtualOperation operation(folder.loaded(), scenario, seed);
    std::uint64_t visible = 0, live = 0, not_finite = 0;
    bool seen = false;
    std::uint64_t number = 0;
    SpoilingLine watched([&](wire::TrackerFrame &frame) {
      number = frame.frame;
      seen = is_seen(frame, "Reference") && is_seen(frame, "Probe");
    });
    operation.set_line(watched);
    operation.observe([&](const wire::NavigationState &state, const wire::SimulatedTruth *) {
      if (wire::view(state.tool) != "Probe" || state.frame != number || !seen ||
          operation.session().state() < bregma_wire_SESSION_VERIFIED) {
        return;
      }
      ++visible;
      live += state.status == bregma_wire_POSE_LIVE ? 1 : 0;
      not_finite += state.status == bregma_wire_POSE_LIVE && !std::isfinite(state.tre_rms_mm) ? 1 : 0;
    });
    if (!operation.run()) { // a fiducial that was touched badly by chance is refused, rightly
      ASSERT_NE(operation.failure().find("contradicts the others"), std::string::npos) << operation.failure();
      ++refused;
      continue;
    }
    ASSERT_GT(visible, 1000U);
    const double fraction = static_cast<double>(live) / static_cast<double>(visible);
    EXPECT_GE(fraction, kMinLiveFraction) << "seed " << seed;
    EXPECT_EQ(not_finite, 0U) << "seed " << seed;
    for (const char *kind : {server::alarm::kImplausible, server::alarm::kCheckMissed, server::alarm::kDrift,
                             server::alarm::kUnknownTool, server::alarm::kUnknownDevice}) {
      const wire::Alarm *alarm = raised(operation, kind);
      EXPECT_EQ(alarm, nullptr) << "seed " << seed << ": " << alarm->text;
    }
    least = std::min(least, fraction);
    frames += operation.received_frames();
  }
  EXPECT_LE(refused, 1 + seeds() / 20);
  std::printf("%llu clean operations, %llu frames, live in at least %.2f %% of the visible ones of each\n",
              static_cast<unsigned long long>(seeds()), static_cast<unsigned long long>(frames), 100.0 * least);
}

// An operation whose probe's data are spoiled from a time after it was shown live for a second.
struct Spoiled {
  explicit Spoiled(const CaseFolder &folder, std::uint64_t seed, const std::function<void(wire::TrackedTool &)> &spoil)
      : operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps), seed),
        line([this, spoil](wire::TrackerFrame &frame) {
          const bool begun = begin_ns && operation.now_ns() >= *begin_ns;
          for (std::uint32_t i = 0; begun && i < frame.tool_count; ++i) {
            if (wire::view(frame.tools[i].tool) == "Probe") {
              spoil(frame.tools[i]);
            }
          }
        }) {
    operation.observe([this](const wire::NavigationState &state, const wire::SimulatedTruth *) {
      if (wire::view(state.tool) != "Probe" || operation.session().state() != bregma_wire_SESSION_NAVIGATING) {
        return;
      }
      if (state.status == bregma_wire_POSE_LIVE && !begin_ns) {
        begin_ns = state.published_time_ns + kSecond_ns;
      }
      wrong += begin_ns && state.published_time_ns > *begin_ns + kLimit_ns && state.status == bregma_wire_POSE_LIVE;
    });
    operation.set_line(line);
    (void)operation.run(90.0); // the operator gives up, or time is over
  }

  std::optional<std::int64_t> begin_ns;
  VirtualOperation operation;
  SpoilingLine line;
  std::uint64_t wrong = 0;
};

TEST(Plausibility, AFaultyProbeIsNotLiveAndItsAlarmNamesToolAndReason) {
  const CaseFolder folder;
  std::optional<wire::TrackedTool> first;
  struct Case {
    const char *reason;
    std::function<void(wire::TrackedTool &)> spoil;
  };
  const Case cases[] = {
      {"repeats to the bit", [&first](wire::TrackedTool &tool) { tool = first.value_or(tool), first = tool; }},
      {"as no hand can", [](wire::TrackedTool &tool) { tool.T_tracker_tool.translation_mm[0] += 100.0; }},
      {"do not fit its geometry", [](wire::TrackedTool &tool) { tool.marker_rms_mm = 50.0; }},
      {"used_markers = 0x3, fewer than three", [](wire::TrackedTool &tool) { tool.used_markers = 0b11; }}};
  for (const Case &one : cases) {
    first.reset();
    const Spoiled run(folder, kSeed, one.spoil);
    ASSERT_TRUE(run.begin_ns) << one.reason << ": " << run.operation.failure();
    EXPECT_EQ(run.wrong, 0U) << one.reason;
    const wire::Alarm *alarm = raised(run.operation, server::alarm::kImplausible);
    ASSERT_NE(alarm, nullptr) << one.reason;
    EXPECT_EQ(wire::view(alarm->subject), "Probe");
    EXPECT_NE(std::string(alarm->text).find(one.reason), std::string::npos) << alarm->text;
    EXPECT_LE(alarm->raised_time_ns, *run.begin_ns + kSecond_ns);
  }
}

TEST(Plausibility, AnUnknownToolInAFrameIsNamedAndTheOthersNavigate) {
  const CaseFolder folder;
  VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps), kSeed);
  SpoilingLine line([](wire::TrackerFrame &frame) {
    wire::TrackedTool &extra = frame.tools[frame.tool_count++];
    extra = frame.tools[0];
    (void)wire::set_name(extra.tool, "Drill");
  });
  operation.set_line(line);
  EXPECT_TRUE(operation.run()) << operation.failure();
  const wire::Alarm *alarm = raised(operation, server::alarm::kUnknownTool);
  ASSERT_NE(alarm, nullptr);
  EXPECT_EQ(wire::view(alarm->subject), "Drill");
}

} // namespace
} // namespace bregma::test
