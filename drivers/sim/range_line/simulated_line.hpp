// A range sensor's microcontroller without hardware: the analogue sensor's voltage in, lines out, in its own time.
// main.cpp puts it behind a pseudo-terminal.
//
// Not for several threads at a time.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "drivers/frame/line_splitter.hpp"
#include "drivers/range/range_line.hpp"
#include "drivers/sim/random.hpp"

namespace bregma::sim {

struct RangeLineFaults {
  unsigned missing_every = 0; // every n-th reading is "-"; 0: none
  unsigned lost_every = 0;    // every n-th line is not sent
  unsigned garbled_every = 0; // one byte of every n-th line is another
};

// Voltage of the analogue sensor at a time of the microcontroller's clock.
using RangeVoltage = std::function<double(std::uint64_t time_us)>;

class SimulatedRangeLine {
public:
  static constexpr std::uint64_t kPeriod_us = 1'000;
  // After a pause the lines of at most this time are sent.
  static constexpr std::uint64_t kBacklog_us = 50'000;

  SimulatedRangeLine(range::Identity identity, const RangeLineFaults &faults, RangeVoltage voltage, std::uint64_t seed)
      : identity_(std::move(identity)), faults_(faults), voltage_(std::move(voltage)), random_(seed, "range line") {}

  // The identity, as at power-on.
  [[nodiscard]] std::string start() const { return range::line_of(identity_); }
  // What it answers to these bytes.
  [[nodiscard]] std::string receive(std::string_view bytes);
  // The readings since the last call, up to this time.
  [[nodiscard]] std::string advance(std::uint64_t now_us);

private:
  [[nodiscard]] std::string line();

  range::Identity identity_;
  RangeLineFaults faults_;
  RangeVoltage voltage_;
  Random random_;
  driver::LineSplitter lines_{range::kMaxLine};
  std::uint64_t counter_ = 0;
  std::uint64_t next_us_ = 0; // of the next reading
};

} // namespace bregma::sim
