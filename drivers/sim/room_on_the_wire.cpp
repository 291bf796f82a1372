#include "drivers/sim/room_on_the_wire.hpp"

#include <algorithm>
#include <thread>

#include <ctime>

namespace bregma::sim {

namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::int64_t read(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * kSecond_ns + now.tv_nsec;
}

// May return early for a signal.
void sleep_until(std::int64_t monotonic_ns) {
  const timespec at{monotonic_ns / kSecond_ns, monotonic_ns % kSecond_ns};
  (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
}

} // namespace

RoomOnTheWire::RoomOnTheWire(SimulatedRoom &room, std::uint32_t domain)
    : room_(&room), participant_(domain), frames_(participant_), truths_(participant_), robot_states_(participant_),
      force_samples_(participant_), range_samples_(participant_), commands_(participant_), replies_(participant_),
      states_(participant_), utc_ahead_ns_(read(CLOCK_REALTIME) - read(CLOCK_MONOTONIC)) {}

std::int64_t RoomOnTheWire::host_now_ns() const { return read(CLOCK_MONOTONIC) + utc_ahead_ns_; }

bool RoomOnTheWire::wait_for_daemon(std::chrono::nanoseconds timeout, const std::atomic<bool> &stop) const {
  const auto end = std::chrono::steady_clock::now() + timeout;
  const auto present = [this] {
    return commands_.matched_readers() > 0 && frames_.matched_readers() > 0 && replies_.matched_writers() > 0;
  };
  while (!present()) {
    if (stop || std::chrono::steady_clock::now() > end) {
      return false;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

// A device that was stopped comes back with the present, not with what it missed: the gap shows in the numbers.
template <class T>
void RoomOnTheWire::write_all(const dds::Writer<T> &writer, const char *device, std::vector<T> &samples,
                              std::int64_t now_ns) {
  Sent &sent = sent_[device];
  for (T &sample : samples) {
    if (now_ns - sample.sent_time_ns > kTooOld_ns) {
      ++dropped_;
      continue;
    }
    sample.sent_time_ns = now_ns;
    const bool written = writer.write(sample);
    sent.written += written ? 1 : 0;
    dropped_ += written ? 0 : 1;
    sent.last_number = std::max(sent.last_number, sample.frame);
  }
}

void RoomOnTheWire::write(RoomOutput &out, std::int64_t now_ns) {
  write_all(frames_, kTrackerDevice, out.frames, now_ns); // first: their latency is measured
  write_all(robot_states_, kRobotDevice, out.robot_states, now_ns);
  write_all(force_samples_, kForceDevice, out.force_samples, now_ns);
  write_all(range_samples_, kRangeDevice, out.range_samples, now_ns);
  for (const auto &truth : out.truths) {
    dropped_ += truths_.write(truth) ? 0 : 1;
  }
  for (const auto &command : out.commands) {
    dropped_ += commands_.write(command) ? 0 : 1;
  }
}

void RoomOnTheWire::run(const std::atomic<bool> &stop, const Tell &tell) {
  RoomOutput out;
  std::int64_t due_ns = host_now_ns();
  while (!stop && !room_->finished()) {
    sleep_until(due_ns - utc_ahead_ns_);
    const std::int64_t now_ns = host_now_ns();
    if (now_ns < due_ns) { // a signal
      continue;
    }
    replies_.take_each([this](const wire::CommandReply &reply, const dds::SampleInfo &) { room_->on_reply(reply); });
    states_.take_each([this, now_ns](const wire::NavigationState &state, const dds::SampleInfo &) {
      room_->on_navigation(state, now_ns);
    });
    room_->advance(now_ns, out);
    write(out, host_now_ns());
    for (const StepEvent &event : out.events) {
      tell(event);
    }
    due_ns = room_->next_due_ns();
  }
}

} // namespace bregma::sim
