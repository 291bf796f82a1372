// Notices steps of the wall clock. Its lead over steady UTC is constant otherwise, and 0 at the start: both follow the
// rate of the time service. Small steps add up until they are noticed. One thread; no allocation, no exceptions.
#pragma once

#include <cstdint>
#include <cstdlib>

#include "server/stages/views.hpp"

namespace bregma::server {

class ClockWatch {
public:
  // lead_ns: wall clock minus steady UTC. True if the clock was stepped since the last call; view() has the size.
  [[nodiscard]] bool observe(std::int64_t lead_ns, std::int64_t now_ns) noexcept {
    const std::int64_t step_ns = lead_ns - lead_ns_;
    if (std::abs(step_ns) < kLeastStep_ns) {
      return false;
    }
    lead_ns_ = lead_ns;
    view_ = {view_.steps + 1, step_ns, now_ns};
    return true;
  }

  [[nodiscard]] const ClockView &view() const noexcept { return view_; }

private:
  // Far above the error of two clocks that are read one after the other (wire::wall_minus_boot_ns).
  static constexpr std::int64_t kLeastStep_ns = 2'000'000;

  std::int64_t lead_ns_ = 0;
  ClockView view_;
};

} // namespace bregma::server
