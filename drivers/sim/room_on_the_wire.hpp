// The simulated room as a device of the driver frame. Samples are published when they are due (absolute deadlines on
// the host's clock). Commands are sent, replies and states are received.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "drivers/frame/device.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/sim/simulated_room.hpp"

namespace bregma::sim {

struct RoomOptions {
  std::filesystem::path case_folder;
  std::filesystem::path scenario;
  std::uint64_t seed = 1;
  double rate_hz = 0.0;    // tracker rate; 0: that of the scenario
  double timeout_s = 30.0; // time to wait for a daemon
  bool live = false;       // repeat the navigation until the driver is stopped
  bool hands_only = false; // the commands are given by a person
};

class RoomOnTheWire final : public driver::Device {
public:
  using Writes = driver::Topics<wire::TrackerFrame, wire::SimulatedTruth, wire::RobotState, wire::ForceSample,
                                wire::RangeSample, wire::Command>;
  using Reads = driver::Topics<wire::CommandReply, wire::NavigationState>;
  using Tell = std::function<void(const StepEvent &)>;

  // The options may change until prepare(). `tell` is called for every event of the script.
  RoomOnTheWire(const RoomOptions &options, Tell tell) : options_(&options), tell_(std::move(tell)) {}

  // Throws std::invalid_argument if the scenario does not match the case.
  [[nodiscard]] base::Result<void> prepare(const driver::Settings &settings) override;
  // Waits for a daemon that reads commands and frames. The timeout is a permanent error.
  [[nodiscard]] driver::Outcome<void> connect(driver::Io &io) override;
  [[nodiscard]] driver::Outcome<driver::Progress> read(driver::Io &io) override;
  void disconnect() noexcept override {}

  // Published samples of one device. Numbers up to last_number that are not among `written` are lost samples: the
  // device lost them itself, or they were due more than kTooOld ago (the process was stopped or starved).
  struct Sent {
    std::uint64_t written = 0; // samples, including faulty ones and copies
    std::uint64_t last_number = 0;
  };
  [[nodiscard]] const std::map<std::string, Sent> &sent() const { return sent_; }
  // Samples, truths and commands that were too old or refused by DDS.
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }

private:
  static constexpr std::int64_t kTooOld_ns = 100'000'000;

  void write(driver::Io &io);
  template <class T> void write_all(driver::Io &io, const char *device, const std::vector<T> &samples);

  const RoomOptions *options_;
  Tell tell_;
  std::int64_t domain_ = 0;
  std::vector<Step> repeated_; // with --live
  std::optional<SimulatedRoom> room_;
  RoomOutput out_;
  std::int64_t due_ns_ = 0;
  std::map<std::string, Sent> sent_;
  std::uint64_t dropped_ = 0;
};

} // namespace bregma::sim
