#include "tests/faults/faulty_line.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "idl/names.hpp"

namespace bregma::faults {
namespace {

constexpr std::uint64_t kOtherWriter = 2;
constexpr std::uint64_t kReturnedWriter = 3;
constexpr std::int64_t kLease_ns = 1'000'000'000; // liveliness of the streams' writers
constexpr std::int64_t kHiccup_ns = 60'000'000;   // of the first writer when a second one appears
const LinkFault kCut{.cut = true};

bool concerns(const Cell &cell, Subject device) { return cell.subject == device || cell.subject == Subject::kNetwork; }

} // namespace

FaultyLine::FaultyLine(const Cell &cell, During session, const std::string &tool, std::uint64_t seed,
                       test::VirtualOperation &operation)
    : cell_(cell), session_(session), tool_(tool), operation_(operation),
      tracker_(sim::kTrackerDevice, concerns(cell, Subject::kTracker), cell, tool, seed),
      robot_(sim::kRobotDevice, concerns(cell, Subject::kRobot), cell, tool, seed),
      force_(sim::kForceDevice, concerns(cell, Subject::kForce), cell, tool, seed),
      range_(sim::kRangeDevice, concerns(cell, Subject::kRange), cell, tool, seed), commands_(seed, "commands"),
      client_(cell.client) {}

void FaultyLine::carry(const sim::RoomOutput &sent, std::int64_t now_ns, test::MemoryTopics &to) {
  for (const sim::StepEvent &event : sent.events) {
    if (begin_ns_ == 0 && event.step == kActivity && event.kind == sim::StepEvent::Kind::kStarted) {
      begin_ns_ = event.time_ns + kFaultAfter_ns;
      end_ns_ = begin_ns_ + static_cast<std::int64_t>(cell_.lasts_s * 1e9);
    }
  }
  host(now_ns);
  for (const wire::SimulatedTruth &truth : sent.truths) {
    exposures_[truth.frame] = truth.time_ns;
  }
  if (observer_) {
    observer_(sent);
  }
  const auto send_all = [&](auto &stream, const auto &samples) {
    for (const auto &sample : samples) {
      send(stream, sample, now_ns);
    }
  };
  send_all(tracker_, sent.frames);
  send_all(robot_, sent.robot_states);
  send_all(force_, sent.force_samples);
  send_all(range_, sent.range_samples);
  for (const wire::Command &command : sent.commands) {
    const bool faulty = cell_.subject == Subject::kClient && lasts(now_ns);
    commands_.send({command}, now_ns, faulty ? &cell_.link : nullptr, 0.0);
  }
  deliver(tracker_, now_ns, to);
  deliver(robot_, now_ns, to);
  deliver(force_, now_ns, to);
  deliver(range_, now_ns, to);
  for (const wire::Command &command : client_.commands(now_ns, begin_ns_, end_ns_)) {
    commands_.send({command, kOtherWriter}, now_ns, nullptr, 0.0);
  }
  if (operation_.daemon_runs()) {
    commands_.deliver(now_ns, [&](const auto &packet) { to.put(packet.sample, packet.writer); });
  }
  was_running_ = operation_.daemon_runs();
}

std::int64_t FaultyLine::next_due_ns() const {
  if (!operation_.daemon_runs()) {
    return server::Stage::kNever; // what has arrived waits for it
  }
  return std::min({tracker_.link.next_due_ns(), robot_.link.next_due_ns(), force_.link.next_due_ns(),
                   range_.link.next_due_ns(), commands_.next_due_ns()});
}

const LinkFault *FaultyLine::link_fault(bool faulty, bool tracker, std::int64_t now_ns) const {
  const bool degraded = tracker && session_ == During::kDegraded && begin_ns_ != 0 &&
                        now_ns >= begin_ns_ - kDegradedBefore_ns && now_ns < begin_ns_ + kDegradedAfter_ns;
  const bool hiccup =
      tracker && cell_.content == Content::kSecondWriter && lasts(now_ns) && now_ns < begin_ns_ + kHiccup_ns;
  if (degraded || hiccup) {
    return &kCut;
  }
  return faulty && lasts(now_ns) ? &cell_.link : nullptr;
}

template <class Sample> void FaultyLine::send(Stream<Sample> &stream, Sample sample, std::int64_t now_ns) {
  constexpr bool kTracker = std::is_same_v<Sample, wire::TrackerFrame>;
  if constexpr (kTracker) {
    if (cell_.content == Content::kSecondWriter && lasts(now_ns)) {
      send_foreign(sample, now_ns);
    }
  }
  if (stream.faulty && begin_ns_ != 0 && now_ns >= begin_ns_) {
    if (!std::exchange(stream.began, true)) {
      stream.tamper.begin(stream.last);
      if (cell_.content == Content::kRenumbered) {
        stream.writer = kOtherWriter;
        ledger_.devices[stream.device].restart_numbers();
        renumbered_by_ = kTracker ? stream.last.frame : renumbered_by_;
      }
    }
    if (now_ns >= end_ns_ && !std::exchange(stream.ended, true) && cell_.link.new_writer_after) {
      stream.writer = kReturnedWriter;
    }
    // A restarted device is first silent.
    if (lasts(now_ns) && cell_.content == Content::kRenumbered) {
      return;
    }
    if (lasts(now_ns) || stream.tamper.stays()) {
      stream.tamper.change(sample);
    }
  }
  stream.last = sample;
  stream.sent_ns[sample.frame] = now_ns;
  const double fault_s = static_cast<double>(now_ns - begin_ns_) * 1e-9;
  stream.link.send({sample, stream.writer, stream.faulty && lasts(now_ns)}, now_ns,
                   link_fault(stream.faulty, kTracker, now_ns), fault_s);
}

bool FaultyLine::is_foreign(std::uint64_t writer) const {
  return cell_.content == Content::kSecondWriter && writer == kOtherWriter;
}

void FaultyLine::send_foreign(const wire::TrackerFrame &frame, std::int64_t now_ns) {
  const wire::TrackerFrame foreign = foreign_frame(frame);
  tracker_.link.send({foreign, kOtherWriter}, now_ns, nullptr, 0.0);
}

template <class Sample> void FaultyLine::deliver(Stream<Sample> &stream, std::int64_t now_ns, test::MemoryTopics &to) {
  if (!operation_.daemon_runs()) {
    constexpr std::size_t kDepth = static_cast<std::size_t>(wire::Topic<Sample>::kQos.depth);
    stream.link.keep_last(kDepth, now_ns);
    return;
  }
  if (!was_running_ && daemon_killed_) {
    stream.link.clear();
  }
  if (stream.faulty && cell_.link.cut) {
    to.set_writers_alive<Sample>(lasts(now_ns) && now_ns >= begin_ns_ + kLease_ns ? 0 : 1);
  }
  stream.link.deliver(now_ns, [&](const typename FaultyLink<Sample>::Packet &packet) {
    if (wire::view(packet.sample.device) == stream.device) {
      const auto sent = stream.sent_ns.find(packet.sample.frame);
      ledger_.devices[stream.device].arrived(packet.sample.frame, !is_foreign(packet.writer),
                                             sent != stream.sent_ns.end() ? sent->second : now_ns, now_ns);
    }
    record(packet);
    to.put(packet.sample, packet.writer);
  });
}

void FaultyLine::record(const FaultyLink<wire::TrackerFrame>::Packet &packet) {
  const std::uint64_t number = packet.sample.frame;
  const bool foreign = is_foreign(packet.writer);
  const auto found = exposures_.find(foreign ? number - kForeignNumbers : number + renumbered_by_);
  const std::int64_t exposure_ns = found != exposures_.end() ? found->second : 0;
  FrameTruth truth{exposure_ns, foreign, {}};
  if (packet.changed) {
    truth = truth_of(cell_.content, tool_, exposure_ns);
    if (cell_.content == Content::kFrozen || cell_.content == Content::kFrozenReference) {
      frozen_exposure_ns_ = frozen_exposure_ns_ == 0 ? exposure_ns : frozen_exposure_ns_;
      truth.exposure_ns = frozen_exposure_ns_;
    }
  }
  ledger_.frames[number] = truth;
}

void FaultyLine::host(std::int64_t now_ns) {
  if (begin_ns_ == 0) {
    return;
  }
  if (now_ns >= begin_ns_ && !std::exchange(host_began_, true)) {
    begin();
  }
  if (now_ns >= end_ns_ && !std::exchange(host_ended_, true)) {
    end();
  }
}

void FaultyLine::begin() {
  namespace fs = std::filesystem;
  const fs::path state = operation_.state_directory();
  switch (cell_.host) {
  case HostFault::kStopped:
    operation_.stop_daemon(end_ns_);
    break;
  case HostFault::kStateDamaged:
    std::ofstream(state / "session.json", std::ios::trunc) << "{\"version\": 2, \"stage\": ";
    [[fallthrough]];
  case HostFault::kKilled:
    daemon_killed_ = true;
    operation_.kill_daemon(end_ns_);
    ledger_.clear_counts();
    break;
  case HostFault::kWallClock:
    operation_.loops().step_wall_clock(static_cast<std::int64_t>(cell_.step_s * 1e9));
    break;
  case HostFault::kRecorderFails:
    operation_.set_recorder({.open = true, .failing = true, .text = "No space left on device"});
    break;
  case HostFault::kRecordsDropped:
    operation_.set_recorder({.dropped = 1000, .open = true});
    break;
  case HostFault::kStateNotWritable:
    fs::create_directories(state / "session.json.tmp");
    break;
  case HostFault::kSecondDaemon:
    operation_.set_other_daemons("bregmad of another host");
    break;
  case HostFault::kNone:
    break;
  }
}

void FaultyLine::end() {
  if (cell_.host == HostFault::kSecondDaemon) {
    operation_.set_other_daemons("");
  } else if (cell_.host == HostFault::kRecorderFails) {
    operation_.set_recorder({.open = true});
  } else if (cell_.host == HostFault::kStateNotWritable) {
    std::filesystem::remove(std::filesystem::path(operation_.state_directory()) / "session.json.tmp");
  }
}

} // namespace bregma::faults
