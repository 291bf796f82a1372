// `bregma watch` as a display beside the real daemon and the simulated room, each of which stands still for a while.
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "idl/boot_clock.hpp"
#include "idl/validity.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

struct Shown {
  std::int64_t at_boot_ns = 0;
  std::uint64_t frame = 0;
  double age_ms = 0.0;
};

// Poses that the display showed as current. The last line may be incomplete.
std::vector<Shown> shown_by(const Process &display) {
  std::vector<Shown> out;
  std::istringstream lines(display.log());
  for (std::string line; std::getline(lines, line);) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (json.is_discarded() || json["tools"].empty() || !json["tools"][0]["fresh"].get<bool>()) {
      continue;
    }
    const auto &tool = json["tools"][0];
    out.push_back({json["boot_time_ns"], tool["frame"], tool["age_ms"]});
  }
  return out;
}

TEST(LiveDisplay, NothingOldIsShownAfterTheClientTheDaemonOrTheDriverStoodStill) {
  Operation operation;
  ASSERT_TRUE(operation.start_unverified()) << operation.logs();
  TemporaryFolder folder;
  Process display({BREGMA_PROGRAM, "watch", "--json", "--rate", "50", "--tool", "Probe", "--domain",
                   std::to_string(operation.domain())},
                  (folder.path() / "display.log").string());
  const auto shows_since = [&](std::int64_t boot_ns) {
    return operation.observe_until([&] {
      operation.observe_for(0.2);
      const auto shown = shown_by(display);
      return std::count_if(shown.begin(), shown.end(), [&](const Shown &line) { return line.at_boot_ns > boot_ns; }) >
             20;
    });
  };
  ASSERT_TRUE(shows_since(0)) << display.log() << operation.logs();
  for (Process *stopped : {&display, &operation.daemon(), &operation.room()}) {
    stopped->signal(SIGSTOP);
    operation.observe_for(3.0);
    const std::int64_t wakes_ns = wire::boot_now_ns();
    stopped->signal(SIGCONT);
    EXPECT_TRUE(shows_since(wakes_ns)) << "it continues without a restart\n" << operation.logs();
  }
  display.signal(SIGTERM);
  EXPECT_EQ(display.wait(20.0), 0);
  operation.observe_for(0.2); // the last frames that the display can have shown

  // Exposures by the boot clock, as the daemon stated them to this observer.
  std::map<std::uint64_t, std::int64_t> exposures;
  for (const wire::NavigationState &state : operation.probe) {
    exposures.emplace(state.frame, state.published_boot_ns - state.age_ns);
  }
  double oldest_ms = 0.0;
  for (const Shown &line : shown_by(display)) {
    const auto exposure = exposures.lower_bound(line.frame); // the observer may have missed a frame
    ASSERT_NE(exposure, exposures.end());
    const double age_ms = static_cast<double>(line.at_boot_ns - exposure->second) * 1e-6;
    EXPECT_LE(age_ms, wire::kLiveLimit_ms) << "frame " << line.frame;
    EXPECT_GE(line.age_ms, age_ms - 1.0) << "the age shown is not too small; frame " << line.frame;
    oldest_ms = std::max(oldest_ms, age_ms);
  }
  std::printf("oldest pose shown as current: %.1f ms\n", oldest_ms);
}

} // namespace
} // namespace bregma::test
