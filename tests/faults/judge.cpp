#include "tests/faults/judge.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "idl/names.hpp"

namespace bregma::faults {
namespace {

constexpr std::int64_t kLimit_ns = 100'000'000; // of the rule, at 30 Hz and more
constexpr std::int64_t kInstant_ns = 100'000;   // one step of the virtual time
constexpr double kMaxUnderstated_ms = 5.0;
constexpr std::int64_t kAlarm_ns = 1'000'000'000;
constexpr std::int64_t kBack_ns = 3'000'000'000;
constexpr std::int64_t kOtherClientsGap_ns = 100'000'000;
constexpr std::int64_t kHealthLag_ns = 250'000'000; // the stages share their counts 10 times per second

double ms(std::int64_t ns) { return static_cast<double>(ns) * 1e-6; }

std::string text_of(double value, const char *unit) {
  char text[64];
  (void)std::snprintf(text, sizeof text, "%.1f %s", value, unit);
  return text;
}

bool is_shown(const wire::NavigationState &state) {
  return state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED;
}

template <std::size_t N> bool finite(const double (&values)[N]) {
  return std::all_of(std::begin(values), std::end(values), [](double value) { return std::isfinite(value); });
}

bool sees(const wire::TrackerFrame &frame, std::string_view name) {
  return std::any_of(frame.tools, frame.tools + frame.tool_count, [&](const wire::TrackedTool &tool) {
    return wire::view(tool.tool) == name &&
           (tool.status == bregma_wire_TOOL_VISIBLE || tool.status == bregma_wire_TOOL_PARTLY_VISIBLE);
  });
}

Eigen::Vector3d position(const wire::Pose &pose) { return Eigen::Vector3d::Map(pose.translation_mm); }

} // namespace

Judge::Judge(const Cell &cell, During session, const std::string &tool, std::uint64_t seed,
             test::VirtualOperation &operation, FaultyLine &line)
    : cell_(cell), session_(session), tool_(tool), operation_(operation), line_(line),
      faulty_display_(cell.subject == Subject::kClient ? &cell : nullptr, seed), other_display_(nullptr, seed) {
  line_.observe([this](const sim::RoomOutput &sent) { on_room(sent); });
  operation_.topics().observe<wire::NavigationState>([this](const auto &state) { on_state(state); });
  operation_.topics().observe<wire::Alarm>([this](const auto &alarm) { on_alarm(alarm); });
  operation_.topics().observe<wire::CommandReply>([this](const auto &reply) {
    if (wire::view(reply.client) == FaultyClient::kName) {
      ++replies_[{reply.id, reply.kind}];
    }
  });
  operation_.topics().observe<wire::SystemHealth>([this](const auto &health) {
    health_ = health;
    health_ns_ = now_ns();
    check_devices();
  });
}

// A device that is called live has sent lately. The health has the status of up to kHealthLag_ns ago.
void Judge::check_devices() {
  for (const auto &[name, ledger] : line_.ledger().devices) {
    for (std::uint32_t i = 0; i < health_.device_count; ++i) {
      const wire::DeviceHealth &device = health_.devices[i];
      const std::int64_t age_ns = now_ns() - ledger.newest_sent_ns();
      if (wire::view(device.device) == name && device.status == bregma_wire_DEVICE_LIVE &&
          age_ns > kLimit_ns + kHealthLag_ns) {
        violate("too old", name + " is called live, its newest sample was sent " + text_of(ms(age_ns), "ms ago"));
      }
    }
  }
}

void Judge::violate(const char *rule, const std::string &text) {
  const auto found = std::find_if(violations_.begin(), violations_.end(),
                                  [&](const Violation &violation) { return violation.rule == rule; });
  if (found != violations_.end()) {
    ++found->count;
    return;
  }
  violations_.push_back({rule, text, began() ? ms(now_ns() - line_.begin_ns()) : -1.0, 1});
}

void Judge::on_room(const sim::RoomOutput &sent) {
  for (const wire::SimulatedTruth &truth : sent.truths) {
    Truth &out = truths_.emplace_back(Truth{truth.time_ns, {}});
    for (std::uint32_t i = 0; i < truth.tool_count; ++i) {
      out.tips_mm[wire::text(truth.tools[i].tool)] = position(truth.tools[i].T_image_tip);
    }
  }
  check_errors();
  draw(faulty_display_, displayed_);
  draw(other_display_, other_displayed_);
  for (const wire::TrackerFrame &frame : sent.frames) {
    const bool seen = sees(frame, tool_) && sees(frame, "Reference");
    const std::int64_t since_last_ns = now_ns() - std::exchange(room_ns_, now_ns());
    const bool clients = cell_.subject == Subject::kClient;
    const bool wrong_clock = cell_.client == ClientFault::kClock;
    check_pause(published_, seen, since_last_ns, cell_.expect.max_gap_ms == 0.0);
    check_pause(other_displayed_, seen, since_last_ns, cell_.expect.max_gap_ms == 0.0 && !clients);
    check_pause(displayed_, seen, since_last_ns, cell_.expect.max_gap_ms == 0.0 || (clients && !wrong_clock));
  }
}

void Judge::draw(Display &display, Watch &watch) {
  display.draw(now_ns(), fault(), [&](const std::string &tool, std::uint64_t number) {
    const FrameTruth *frame = line_.ledger().frame(number);
    if (frame == nullptr) {
      return; // the daemon itself is judged for this
    }
    const std::int64_t age_ns = now_ns() - frame->exposure_ns;
    figures_.oldest_displayed_ms = std::max(figures_.oldest_displayed_ms, ms(age_ns));
    if (age_ns > kLimit_ns + kInstant_ns) {
      violate("too old", watch.who + std::string(" shows ") + tool + " at an age of " + text_of(ms(age_ns), "ms"));
    } else if (tool == tool_) {
      saw(watch, frame->exposure_ns);
    }
  });
}

void Judge::saw(Watch &watch, std::int64_t exposure_ns) {
  watch.shown_ns = now_ns();
  if (ended() && exposure_ns >= line_.end_ns() && !watch.back) {
    watch.back = true;
    figures_.back_ms = std::max(figures_.back_ms, ms(now_ns() - line_.end_ns()));
  }
}

void Judge::check_pause(Watch &watch, bool seen, std::int64_t since_last_ns, bool may_pause) {
  if (!poses_expected()) {
    return;
  }
  const bool still_degraded =
      session_ == During::kDegraded && now_ns() < line_.begin_ns() + kDegradedAfter_ns + kLimit_ns;
  if (!seen || !began() || still_degraded) {
    watch.shown_ns = now_ns();
    return;
  }
  const std::int64_t gap_ns = now_ns() - watch.shown_ns;
  figures_.gap_ms = std::max(figures_.gap_ms, ms(gap_ns));
  const double limit_ms = cell_.expect.max_gap_ms > 0.0 ? cell_.expect.max_gap_ms : ms(kOtherClientsGap_ns);
  if (!may_pause && ms(gap_ns) > limit_ms) {
    violate("gap", std::string(watch.who) + " shows no " + tool_ + " for more than " + text_of(limit_ms, "ms"));
  }
  if (ended() && !watch.back && !cell_.expect.reverify && !cell_.expect.idle_after) {
    watch.absent_ns += since_last_ns;
    if (watch.absent_ns > kBack_ns) {
      violate("not back", std::string(watch.who) + " shows no " + tool_ + " 3 s after the fault's end");
    }
  }
}

void Judge::on_state(const wire::NavigationState &state) {
  faulty_display_.receive(state, now_ns(), fault());
  other_display_.receive(state, now_ns(), fault());
  if (!is_shown(state)) {
    return;
  }
  ++figures_.shown;
  check_values(state);
  const std::string tool = wire::text(state.tool);
  const FrameTruth *frame = line_.ledger().frame(state.frame);
  if (frame == nullptr || frame->unusable || frame->unusable_tool == tool) {
    violate("unusable",
            tool + " is shown from " + (frame == nullptr ? "a frame that never arrived" : "a faulty frame"));
    return;
  }
  check_age(state, *frame);
  if (tool == tool_) {
    saw(published_, frame->exposure_ns);
  }
  const Eigen::Matrix<double, 6, 6, Eigen::RowMajor> covariance =
      Eigen::Matrix<double, 6, 6, Eigen::RowMajor>::Map(state.covariance);
  const Eigen::Vector3d tip = position(state.T_image_tip);
  waiting_.push_back({now_ns(), tip, uncertainty::tre_covariance(covariance, tip), tool});
}

void Judge::check_values(const wire::NavigationState &state) {
  const bool whole = finite(state.T_image_tip.rotation_wxyz) && finite(state.T_image_tip.translation_mm) &&
                     finite(state.velocity_mm_s) && finite(state.covariance) && std::isfinite(state.tre_rms_mm) &&
                     finite(state.tre_95.semi_axes_mm) && finite(state.tre_95.axes);
  if (!whole) {
    violate("not finite", wire::text(state.tool) + " is shown with values that are not finite");
  }
}

void Judge::check_age(const wire::NavigationState &state, const FrameTruth &frame) {
  const std::int64_t age_ns = now_ns() - frame.exposure_ns;
  figures_.oldest_shown_ms = std::max(figures_.oldest_shown_ms, ms(age_ns));
  if (age_ns > kLimit_ns + kInstant_ns) {
    violate("too old", "the daemon shows " + wire::text(state.tool) + " at an age of " + text_of(ms(age_ns), "ms"));
  }
  const double understated_ms = ms(age_ns - state.age_ns);
  figures_.age_understated_ms = std::max(figures_.age_understated_ms, understated_ms);
  if (understated_ms > kMaxUnderstated_ms) {
    violate("understated",
            "the stated age of " + wire::text(state.tool) + " is " + text_of(understated_ms, "ms too small"));
  }
}

// Positions between two exposures are interpolated.
void Judge::check_errors() {
  while (!waiting_.empty() && truths_.size() > 1) {
    const Shown &shown = waiting_.front();
    if (truths_[1].time_ns < shown.published_ns) {
      truths_.pop_front();
      continue;
    }
    check_error(shown, truths_[0], truths_[1]);
    waiting_.pop_front();
  }
}

void Judge::check_error(const Shown &shown, const Truth &before, const Truth &after) {
  const double share =
      static_cast<double>(shown.published_ns - before.time_ns) / static_cast<double>(after.time_ns - before.time_ns);
  const Eigen::Vector3d truth =
      before.tips_mm.at(shown.tool) + share * (after.tips_mm.at(shown.tool) - before.tips_mm.at(shown.tool));
  const Eigen::Vector3d error = shown.tip_mm - truth;
  const double statistic = uncertainty::mahalanobis_squared(shown.covariance, error);
  static const double kBound = uncertainty::chi_square_upper_quantile(kTail, 3);
  if (in_grace(shown.published_ns)) {
    return;
  }
  figures_.largest_error_ratio = std::max(figures_.largest_error_ratio, statistic / kBound);
  if (!(statistic <= kBound)) {
    violate("outside", shown.tool + " is shown " + text_of(error.norm(), "mm") + " beside the truth, stated are " +
                           text_of(uncertainty::rms_mm(shown.covariance), "mm"));
  }
}

// Values that are wrong and look right may be shown for the time of the rule.
bool Judge::in_grace(std::int64_t time_ns) const {
  const auto just_after = [time_ns](std::int64_t event_ns) {
    return event_ns != 0 && time_ns >= event_ns && time_ns < event_ns + kLimit_ns;
  };
  const bool silent = session_ == During::kDegraded; // the first faulty samples arrive later
  return !cell_.expect.malformed && cell_.content != Content::kTrue &&
         (just_after(line_.begin_ns() + (silent ? kDegradedAfter_ns : 0)) || just_after(line_.end_ns()));
}

void Judge::on_alarm(const wire::Alarm &alarm) {
  const std::string name = wire::text(alarm.kind) + " " + wire::text(alarm.subject);
  if (alarm.state == bregma_wire_ALARM_CLEARED) {
    standing_.erase(name);
    return;
  }
  standing_.insert(name);
  if (alarm.state != bregma_wire_ALARM_RAISED) {
    return;
  }
  raised_.push_back({now_ns(), name + ": " + alarm.text});
  const bool degraded = session_ == During::kDegraded && wire::view(alarm.kind) == "tracker_lost";
  if (began() && alarm.severity == bregma_wire_SEVERITY_CRITICAL && !cell_.expect.critical && !degraded) {
    violate("false alarm", name + ": " + alarm.text);
  }
}

void Judge::finish(const std::string &failure) {
  if (!failure.empty()) {
    violate("not back", "the operator: " + failure);
  }
  if (!began()) {
    violate("not back", "the fault never began");
    return;
  }
  if (poses_expected() && !published_.back && !cell_.expect.idle_after) {
    violate("not back", "no pose of " + tool_ + " was shown after the fault");
  }
  check_alarm();
  check_counts();
  check_replies();
}

void Judge::check_alarm() {
  if (cell_.expect.alarm.empty() || session_ < cell_.expect.alarm_from) {
    return;
  }
  const auto expected = [this](const Raised &raised) {
    return std::any_of(cell_.expect.alarm.begin(), cell_.expect.alarm.end(),
                       [&](const std::string &word) { return raised.text.find(word) != std::string::npos; });
  };
  for (const Raised &raised : raised_) {
    // One that stands when the fault begins is as good: it is not raised twice.
    if (raised.time_ns > line_.begin_ns() - kAlarm_ns && expected(raised)) {
      figures_.alarm_ms = std::max(0.0, ms(raised.time_ns - line_.begin_ns()));
      break;
    }
  }
  if (figures_.alarm_ms < 0.0) {
    violate("no alarm", "no alarm names " + cell_.expect.alarm.front());
  } else if (figures_.alarm_ms > ms(kAlarm_ns)) {
    violate("no alarm", "the alarm came after " + text_of(figures_.alarm_ms, "ms"));
  }
}

void Judge::check_counts() {
  for (const auto &[name, ledger] : line_.ledger().devices) {
    const wire::DeviceHealth *const begin = health_.devices;
    const wire::DeviceHealth *const end = begin + health_.device_count;
    const wire::DeviceHealth *const device =
        std::find_if(begin, end, [&name = name](const auto &one) { return wire::view(one.device) == name; });
    if (device == end) {
      violate("not counted", name + " is not in the daemon's health");
      continue;
    }
    check_count(*device, ledger);
  }
}

void Judge::check_count(const wire::DeviceHealth &device, const DeviceLedger &ledger) {
  const std::string name = wire::text(device.device);
  std::uint64_t counted = device.taken;
  for (const std::uint64_t rejected : device.rejected) {
    counted += rejected;
  }
  const std::uint64_t at_least = ledger.arrivals(health_ns_ - kHealthLag_ns);
  const std::uint64_t at_most = ledger.arrivals(health_ns_);
  if (counted < at_least || counted > at_most) {
    violate("not counted", name + ": taken + rejected = " + std::to_string(counted) + ", arrived are " +
                               std::to_string(at_least) + " to " + std::to_string(at_most));
  } else if (const std::uint64_t lost = ledger.lost(counted); device.lost != lost) {
    violate("not counted", name + ": lost = " + std::to_string(device.lost) + ", it is " + std::to_string(lost));
  }
}

// A client that floods the daemon is answered only now and then.
void Judge::check_replies() {
  if (cell_.client == ClientFault::kFloods) {
    return;
  }
  for (const FaultyClient::Asked &asked : line_.client().asked()) {
    if (replies_[{asked.id, asked.kind}] == 0) {
      violate("no reply",
              "command " + std::to_string(asked.id) + " of kind " + std::to_string(asked.kind) + " was not answered");
    }
  }
}

} // namespace bregma::faults
