// A coil controller without hardware: bytes in, bytes out, in its own time. main.cpp puts it behind a pseudo-terminal.
//
// Not for several threads at a time.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "drivers/coils/coil_line.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/sim/random.hpp"

namespace bregma::sim {

struct CoilFaults {
  std::uint64_t open = 0; // coils with an open cable
  double gain = 1.0;      // of the amplifier
  double ripple = 0.002;  // relative, 1 sigma, of a measurement
  int drop_every = 0;     // every n-th message is lost; 0: none
};

class SimulatedController {
public:
  explicit SimulatedController(const CoilFaults &faults, std::uint64_t seed)
      : faults_(faults), random_(seed, "coils") {}

  // Received bytes at a time of the controller's clock; what it answers.
  [[nodiscard]] std::string receive(std::string_view bytes, std::int64_t now_ms);
  // Switches off when the hold has run out.
  void advance(std::int64_t now_ms);
  // Coils that carry current now.
  [[nodiscard]] std::uint64_t on() const { return coils_ & ~faults_.open; }
  [[nodiscard]] double current_mA() const { return static_cast<double>(current_uA_) * 1e-3 * faults_.gain; }

private:
  [[nodiscard]] coils::State measure(std::int64_t now_ms);

  CoilFaults faults_;
  Random random_;
  driver::LineSplitter lines_{coils::kMaxLine};
  std::uint64_t coils_ = 0;
  std::int64_t current_uA_ = 0;
  std::int64_t off_at_ms_ = 0;
  std::uint32_t counter_ = 0;
};

} // namespace bregma::sim
