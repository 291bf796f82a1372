// Puts the simulated room on DDS in real time: samples are written when they fall due (absolute deadlines on the
// monotonic clock), commands go out, replies and states come back. One thread, the caller's.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "drivers/sim/simulated_room.hpp"
#include "idl/dds.hpp"

namespace bregma::sim {

class RoomOnTheWire {
public:
  using Tell = std::function<void(const StepEvent &)>;

  // Throws dds::Error.
  RoomOnTheWire(SimulatedRoom &room, std::uint32_t domain);

  // True when a daemon takes commands and frames; false when none came in time or stop was set.
  [[nodiscard]] bool wait_for_daemon(std::chrono::nanoseconds timeout, const std::atomic<bool> &stop) const;

  // Until the script is over or stop is set. tell is called for every event of the script.
  void run(const std::atomic<bool> &stop, const Tell &tell);

  // What one device has given to the wire. Numbers up to last_number that are not among `written` are lost samples:
  // the device lost them itself, or they fell due more than kTooOld ago (the process was stopped or starved).
  struct Sent {
    std::uint64_t written = 0; // samples, hostile ones and copies among them
    std::uint64_t last_number = 0;
  };
  [[nodiscard]] const std::map<std::string, Sent> &sent() const { return sent_; }
  // Samples, truths and commands that were too old or that DDS did not take.
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }

private:
  static constexpr std::int64_t kTooOld_ns = 100'000'000;

  [[nodiscard]] std::int64_t host_now_ns() const; // UTC that never steps
  void write(RoomOutput &out, std::int64_t now_ns);
  template <class T>
  void write_all(const dds::Writer<T> &writer, const char *device, std::vector<T> &samples, std::int64_t now_ns);

  SimulatedRoom *room_;
  dds::Participant participant_;
  dds::Writer<wire::TrackerFrame> frames_;
  dds::Writer<wire::SimulatedTruth> truths_;
  dds::Writer<wire::RobotState> robot_states_;
  dds::Writer<wire::ForceSample> force_samples_;
  dds::Writer<wire::RangeSample> range_samples_;
  dds::Writer<wire::Command> commands_;
  dds::Reader<wire::CommandReply> replies_;
  dds::Reader<wire::NavigationState> states_;
  std::int64_t utc_ahead_ns_; // the host's UTC at the start minus monotonic time
  std::map<std::string, Sent> sent_;
  std::uint64_t dropped_ = 0;
};

} // namespace bregma::sim
