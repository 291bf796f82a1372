// Orders of the procedure to scanner and coil controller, what they answer, and what happens to them.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <utility>

#include "server/stages/scanner/procedure.hpp"

namespace bregma::server {

namespace {

constexpr std::int64_t kOffNow_ns = -1; // the coils are switched off at the end of the next poll

std::string number(double value) {
  char out[32];
  std::snprintf(out, sizeof out, "%.6g", value);
  return out;
}

} // namespace

void Procedure::start_scan(std::int64_t now_ns) {
  const PlannedScan &scan = plan_[scan_];
  next_ = "wait";
  if (scan.pattern.empty()) {
    return acquire(now_ns);
  }
  const bool off = scan.pattern == kOff;
  if (!off) {
    coils_ordered_ = true;
    hold_ends_ns_ = now_ns + static_cast<std::int64_t>(1e9 * options_.hold_s);
  }
  order(options_.coils, bregma_wire_COMMAND_SET_COILS,
        {options_.coils, scan.pattern, off ? "0" : number(options_.current_mA), off ? "0" : number(options_.hold_s)},
        now_ns);
  phase_ = Phase::kSwitching;
  activity_ = bregma_wire_SCANNER_SWITCHES_COILS;
  text_ = "coils: " + scan.pattern;
  changed();
}

void Procedure::acquire(std::int64_t now_ns) {
  const PlannedScan &scan = plan_[scan_];
  order(options_.scanner, bregma_wire_COMMAND_ACQUIRE_SERIES,
        {options_.scanner, scan.protocol, std::to_string(scan.slices)}, now_ns);
  deadline_ns_ = now_ns + options_.series_timeout_ns;
  series_replied_ = false;
  series_.reset();
  phase_ = Phase::kWaiting;
  activity_ = bregma_wire_SCANNER_ACQUIRES;
  text_ = "series " + scan.protocol +
          (scan.role == Role::kBackground   ? ", coils off"
           : scan.role == Role::kForeground ? ", coils on"
                                            : "");
  changed();
}

void Procedure::order(const std::string &device, wire::CommandKind kind, std::vector<std::string> values,
                      std::int64_t now_ns) {
  awaited_id_ = new_id(now_ns);
  deadline_ns_ = now_ns + options_.reply_timeout_ns;
  orders_.push_back({awaited_id_, device, kind, std::move(values)});
}

std::uint64_t Procedure::new_id(std::int64_t now_ns) {
  next_id_ = next_id_ == 0 ? static_cast<std::uint64_t>(now_ns) : next_id_;
  return next_id_++;
}

void Procedure::switch_off() { off_deadline_ns_ = kOffNow_ns; }

void Procedure::confirmed_off() {
  off_id_ = 0;
  off_deadline_ns_ = 0;
  coils_ordered_ = false;
  coils_fault_.clear();
}

void Procedure::on_reply(const wire::CommandReply &reply, std::int64_t now_ns) {
  const std::string text(reply.text, strnlen(reply.text, sizeof reply.text));
  const bool done = reply.result == bregma_wire_COMMAND_DONE;
  if (off_id_ != 0 && reply.id == off_id_) {
    if (done) {
      confirmed_off();
    } else {
      coils_fault_ = "the coils were not switched off: " + text + "; disconnect the coil controller";
      off_id_ = 0; // ordered again at the deadline
    }
    changed();
    return;
  }
  if (reply.id != awaited_id_ || !busy() || phase_ == Phase::kComputing) {
    return;
  }
  if (!done) {
    return fail((phase_ == Phase::kSwitching ? options_.coils : options_.scanner) + ": " + text);
  }
  if (phase_ == Phase::kSwitching && plan_[scan_].pattern == kOff) {
    confirmed_off();
  }
  if (phase_ != Phase::kSwitching) {
    series_replied_ = true;
    deadline_ns_ = std::min(deadline_ns_, now_ns + kStragglers_ns);
  } else if (plan_[scan_].protocol.empty()) {
    next_scan(now_ns);
  } else {
    acquire(now_ns);
    if (plan_[scan_].pattern != kOff) { // coils without current are named
      text_ += ": " + text;
    }
  }
}

void Procedure::poll(std::int64_t now_ns) {
  if (off_deadline_ns_ > 0 && now_ns >= off_deadline_ns_) {
    if (off_id_ != 0) {
      coils_fault_ = "the coil controller has not answered: the coils may carry current; disconnect it";
    }
    switch_off(); // again, until it is confirmed
    changed();
  }
  poll_step(now_ns);
  if (accepted_ && validity_ == bregma_wire_SCANNER_VALID && has_expired(accepted_->field_expires_ns, now_ns)) {
    void_registration(bregma_wire_SCANNER_FIELD_EXPIRED, "the distortion field has expired: measure it again");
  }
  if (off_deadline_ns_ == kOffNow_ns) {
    off_id_ = new_id(now_ns);
    off_deadline_ns_ = now_ns + options_.reply_timeout_ns;
    orders_.push_back({off_id_, options_.coils, bregma_wire_COMMAND_SET_COILS, {options_.coils, kOff, "0", "0"}});
  }
}

void Procedure::poll_step(std::int64_t now_ns) {
  if (phase_ == Phase::kComputing) {
    return take_field();
  }
  const bool series = phase_ == Phase::kWaiting || phase_ == Phase::kReceiving;
  if (series && scans(Role::kForeground) && now_ns >= hold_ends_ns_) {
    return fail("the coils were on for " + number(options_.hold_s) +
                    " s, after which their controller switches them off, before the series was complete",
                "take fewer slices or a longer hold (scanner.hold_s), then confirm " + name_of(step_));
  }
  const bool absent = no_writer_ns_ != 0 && now_ns - no_writer_ns_ >= options_.reply_timeout_ns;
  if (series && (absent || scanner_driver_.is_silent(now_ns))) {
    return fail("the driver of " + options_.scanner + " has ended or is not reached: start it again");
  }
  if (series && scans(Role::kForeground) && coils_driver_.is_silent(now_ns)) {
    return fail("the driver of " + options_.coils + " has ended or is not reached: start it again");
  }
  if (busy() && now_ns >= deadline_ns_) {
    const std::string who = phase_ == Phase::kSwitching ? options_.coils : options_.scanner;
    fail(phase_ == Phase::kReceiving ? std::to_string(series_->received()) + " of " +
                                           std::to_string(series_->expected()) + " slices came, then no more"
                                     : who + " has not answered: is its driver started?");
  }
}

void Procedure::on_driver(const wire::DriverHealth &health, std::int64_t now_ns) {
  const bool coils = wire::view(health.device) == options_.coils;
  if (!coils && wire::view(health.device) != options_.scanner) {
    return;
  }
  SeenDriver &seen = coils ? coils_driver_ : scanner_driver_;
  const SeenDriver before =
      std::exchange(seen, SeenDriver{health.started_time_ns, health.connections, now_ns,
                                     health.state == bregma_wire_DRIVER_CONNECTED && health.connections > 0, true});
  const bool returned = seen.connected && (!before.connected || before.started_ns != seen.started_ns ||
                                           before.connections != seen.connections);
  const bool series = phase_ == Phase::kWaiting || phase_ == Phase::kReceiving;
  const bool on = (series && scans(Role::kForeground)) || scans(Role::kOff); // or were just now
  if (coils && on && before.seen && (returned || !seen.connected)) {
    const std::string why(health.failure, strnlen(health.failure, sizeof health.failure));
    fail("the coil controller was lost within a series, and the coils with it" + (why.empty() ? "" : ": " + why));
  } else if (coils && returned && options_.frame && !scans(Role::kForeground)) {
    switch_off(); // a daemon that ended may have left them on
  } else if (!coils && series && before.seen && before.started_ns != seen.started_ns) {
    fail("the driver of " + options_.scanner + " was started again within a series: it does not know of the order");
  }
}

} // namespace bregma::server
