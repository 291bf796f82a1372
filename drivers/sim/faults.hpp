// Faults and their times, which count from the start of the run or from the first start of a named step.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "drivers/sim/scenario.hpp"
#include "idl/topics.hpp"

namespace bregma::sim {

class FaultSchedule {
public:
  explicit FaultSchedule(const std::vector<Fault> &faults);

  void start(std::int64_t now_ns);
  void step_started(std::string_view step, std::int64_t now_ns);

  [[nodiscard]] bool occluded(std::string_view tool, std::int64_t time_ns) const;
  [[nodiscard]] bool tracker_silent(std::int64_t time_ns) const;
  // Factor on the device's stated rate; 1 without a flood.
  [[nodiscard]] double rate_factor(std::string_view device, std::int64_t time_ns) const;
  // The next due instantaneous fault (bump, clock jump, bad samples). Each is returned once.
  [[nodiscard]] const Fault *take_due(std::int64_t time_ns);

private:
  struct Entry {
    Fault fault;
    std::optional<std::int64_t> start_ns; // unknown until its step starts
    bool taken = false;
    [[nodiscard]] bool lasts(std::int64_t time_ns) const;
  };
  std::vector<Entry> entries_;
};

// True for kinds that modify the frame itself; the others add a sample that should not exist.
[[nodiscard]] bool replaces(BadSample kind);
// A faulty frame, like that of a broken or hostile driver, made from a valid one.
[[nodiscard]] wire::TrackerFrame spoiled(const wire::TrackerFrame &good, BadSample kind);

} // namespace bregma::sim
