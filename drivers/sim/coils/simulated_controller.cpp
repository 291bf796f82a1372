#include "drivers/sim/coils/simulated_controller.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace bregma::sim {

void SimulatedController::advance(std::int64_t now_ms) {
  if (coils_ != 0 && now_ms >= off_at_ms_) {
    coils_ = 0;
    current_uA_ = 0;
  }
}

std::string SimulatedController::receive(std::string_view bytes, std::int64_t now_ms) {
  std::string out;
  advance(now_ms);
  lines_.take(bytes, [&](std::string_view line) {
    const auto order = coils::parse_order(line);
    if (!order) {
      return; // as the device: what it cannot read it ignores
    }
    if (order->kind == coils::Order::Kind::kOff) {
      coils_ = 0;
      current_uA_ = 0;
    } else if (order->kind == coils::Order::Kind::kSet) {
      coils_ = order->coils;
      current_uA_ = order->current_uA;
      off_at_ms_ = now_ms + order->hold_ms;
      advance(now_ms);
    }
    const coils::State state = measure(now_ms);
    if (faults_.drop_every == 0 || state.counter % static_cast<std::uint32_t>(faults_.drop_every) != 0) {
      out += coils::line_of(state);
    }
  });
  return out;
}

coils::State SimulatedController::measure(std::int64_t now_ms) {
  coils::State out;
  out.counter = ++counter_;
  out.coils = coils_;
  out.current_uA = current_uA_;
  out.left_ms = coils_ != 0 ? std::clamp<std::int64_t>(off_at_ms_ - now_ms, 0, coils::kMaxHold_ms) : 0;
  out.faults = coils_ & faults_.open;
  bool first = true;
  for (unsigned i = 0; i < 64; ++i) {
    if ((on() >> i & 1U) != 0) {
      const double value =
          std::abs(static_cast<double>(current_uA_)) * faults_.gain * (1.0 + random_.normal(faults_.ripple));
      const std::int64_t measured = std::clamp<std::int64_t>(std::llround(value), 0, coils::kMaxCurrent_uA);
      out.lowest_uA = first ? measured : std::min(out.lowest_uA, measured);
      out.highest_uA = std::max(out.highest_uA, measured);
      first = false;
    }
  }
  return out;
}

} // namespace bregma::sim
