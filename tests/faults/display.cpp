#include "tests/faults/display.hpp"

#include "idl/names.hpp"

namespace bregma::faults {

Display::Display(const Cell *cell, std::uint64_t seed) : states_(seed, "states"), health_(seed, "health") {
  if (cell != nullptr) {
    link_ = cell->link;
    fault_ = cell->client;
    clock_error_ns_ = fault_ == ClientFault::kClock ? static_cast<std::int64_t>(cell->step_s * 1e9) : 0;
  }
}

bool Display::runs(std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns) const {
  if (fault_ == ClientFault::kLate) {
    return end_ns != 0 && now_ns >= end_ns;
  }
  return fault_ != ClientFault::kStopped || begin_ns == 0 || now_ns < begin_ns || now_ns >= end_ns;
}

const LinkFault *Display::link_fault(std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns) const {
  return begin_ns != 0 && now_ns >= begin_ns && now_ns < end_ns ? &link_ : nullptr;
}

void Display::receive(const wire::NavigationState &state, std::int64_t now_ns, std::int64_t begin_ns,
                      std::int64_t end_ns) {
  states_.send({state}, now_ns, link_fault(now_ns, begin_ns, end_ns), 0.0);
}

void Display::receive(const wire::SystemHealth &health, std::int64_t now_ns, std::int64_t begin_ns,
                      std::int64_t end_ns) {
  health_.send({health}, now_ns, link_fault(now_ns, begin_ns, end_ns), 0.0);
}

void Display::take(std::int64_t now_ns) {
  health_.deliver(now_ns, [this](const auto &packet) { snapshot_.health = packet.sample; });
  states_.deliver(now_ns,
                  [this](const auto &packet) { snapshot_.tools[wire::text(packet.sample.tool)] = packet.sample; });
}

} // namespace bregma::faults
