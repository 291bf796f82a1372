#include "drivers/sim/room_on_the_wire.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "drivers/frame/settings.hpp"

namespace bregma::sim {

namespace {

constexpr std::int64_t kMillisecond_ns = 1'000'000;

// Steps repeated by --live: the script from the first start of navigation on.
std::vector<Step> live_part(const Scenario &scenario) {
  const auto first = std::find_if(scenario.steps.begin(), scenario.steps.end(),
                                  [](const Step &step) { return step.kind == StepKind::kStartNavigation; });
  std::vector<Step> out(first, scenario.steps.end());
  std::erase_if(out, [](const Step &step) { return step.kind == StepKind::kCloseCase; });
  // A navigation that was not stopped cannot be started again.
  if (!out.empty() && out.back().kind != StepKind::kStopNavigation) {
    out.push_back({StepKind::kStopNavigation, "stop_navigation", {}, {}, {}});
  }
  return out;
}

// True if a daemon reads commands and frames; false after the timeout or if the driver must stop.
bool wait_for_daemon(driver::Io &io, std::int64_t timeout_ns) {
  const std::int64_t end_ns = io.now_ns() + timeout_ns;
  const auto present = [&io] {
    return io.matched<wire::Command>() > 0 && io.matched<wire::TrackerFrame>() > 0 &&
           io.matched<wire::CommandReply>() > 0;
  };
  while (!present()) {
    if (io.now_ns() > end_ns || !io.wait_until(io.now_ns() + 20 * kMillisecond_ns)) {
      return false;
    }
  }
  return true;
}

} // namespace

base::Result<void> RoomOnTheWire::prepare(const driver::Settings &settings) {
  domain_ = settings.domain_id;
  auto scenario = load_scenario(options_->scenario);
  if (!scenario) {
    return tl::unexpected(scenario.error());
  }
  if (options_->rate_hz > 0.0) {
    scenario->tracker.rate_hz = options_->rate_hz;
  }
  scenario->hand.hands_only = options_->hands_only;
  if (options_->live) {
    repeated_ = live_part(*scenario);
    if (repeated_.empty()) {
      return base::failure(options_->scenario.string() + ": --live needs a step start_navigation to repeat");
    }
    std::erase_if(scenario->steps, [](const Step &step) { return step.kind == StepKind::kCloseCase; });
    if (scenario->steps.back().kind != StepKind::kStopNavigation) {
      scenario->steps.push_back(repeated_.back());
    }
  }
  const auto loaded = casefile::load_case(std::filesystem::absolute(options_->case_folder));
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  room_.emplace(*loaded, *scenario, options_->seed);
  return {};
}

driver::Outcome<void> RoomOnTheWire::connect(driver::Io &io) {
  if (!wait_for_daemon(io, 300 * kMillisecond_ns) && !io.stopping()) {
    std::fprintf(stderr, "bregma-sim-room: waiting for bregmad on domain %lld ...\n", static_cast<long long>(domain_));
    if (!wait_for_daemon(io, std::llround(options_->timeout_s * 1e9)) && !io.stopping()) {
      char text[96];
      (void)std::snprintf(text, sizeof text, "no bregmad on domain %lld within %.0f s", static_cast<long long>(domain_),
                          options_->timeout_s);
      return driver::give_up(text);
    }
  }
  due_ns_ = io.now_ns();
  return {};
}

// A device that was stopped continues with current samples. The missed ones appear as a gap in the numbers.
template <class T> void RoomOnTheWire::write_all(driver::Io &io, const char *device, const std::vector<T> &samples) {
  Sent &sent = sent_[device];
  for (const T &sample : samples) {
    if (io.now_ns() - sample.sent_time_ns > kTooOld_ns) {
      ++dropped_;
      continue;
    }
    const bool written = io.publish(sample);
    sent.written += written ? 1 : 0;
    dropped_ += written ? 0 : 1;
    sent.last_number = std::max<std::uint64_t>(sent.last_number, sample.frame);
  }
}

void RoomOnTheWire::write(driver::Io &io) {
  write_all(io, kTrackerDevice, out_.frames); // first, because their latency is measured
  write_all(io, kRobotDevice, out_.robot_states);
  write_all(io, kForceDevice, out_.force_samples);
  write_all(io, kRangeDevice, out_.range_samples);
  for (const auto &truth : out_.truths) {
    dropped_ += io.publish(truth) ? 0 : 1;
  }
  for (const auto &command : out_.commands) {
    dropped_ += io.publish(command) ? 0 : 1;
  }
}

driver::Outcome<driver::Progress> RoomOnTheWire::read(driver::Io &io) {
  if (!io.wait_until(due_ns_)) {
    return driver::Progress::kContinue;
  }
  const std::int64_t now_ns = io.now_ns();
  io.take<wire::CommandReply>([this](const wire::CommandReply &reply) { room_->on_reply(reply); });
  io.take<wire::NavigationState>(
      [this, now_ns](const wire::NavigationState &state) { room_->on_navigation(state, now_ns); });
  room_->advance(now_ns, out_);
  write(io);
  for (const StepEvent &event : out_.events) {
    tell_(event);
  }
  due_ns_ = room_->next_due_ns();
  if (!room_->finished()) {
    return driver::Progress::kContinue;
  }
  if (room_->failed()) {
    return driver::give_up(room_->failure());
  }
  if (!options_->live) {
    return driver::Progress::kFinished;
  }
  room_->continue_with(repeated_);
  due_ns_ = io.now_ns();
  return driver::Progress::kContinue;
}

} // namespace bregma::sim
