#include "tests/faults/display.hpp"

#include "idl/names.hpp"

namespace bregma::faults {
namespace {

// Boot identities of the daemon's host in virtual time, and of another one.
constexpr std::array<std::uint8_t, 16> kDaemonHost{1};
constexpr std::array<std::uint8_t, 16> kOtherHost{2};

} // namespace

Display::Display(const Cell *cell, std::uint64_t seed)
    : states_(seed, "states"), transit_(cell != nullptr ? kOtherHost : kDaemonHost) {
  if (cell != nullptr) {
    link_ = cell->link;
    fault_ = cell->client;
    boot_lead_ns_ = static_cast<std::int64_t>(cell->step_s * 1e9);
  }
}

bool Display::runs(std::int64_t now_ns, const FaultTime &fault) const {
  if (fault_ == ClientFault::kLate) {
    return fault.end_ns != 0 && now_ns >= fault.end_ns;
  }
  return fault_ != ClientFault::kStopped || !fault.lasts(now_ns);
}

void Display::receive(const wire::NavigationState &state, std::int64_t now_ns, const FaultTime &fault) {
  daemon_boot_ns_ = state.published_boot_ns - now_ns;
  states_.send({state}, now_ns, fault.lasts(now_ns) ? &link_ : nullptr, 0.0);
}

void Display::take(std::int64_t now_ns) {
  states_.deliver(now_ns, [&](const auto &packet) {
    const wire::NavigationState &state = packet.sample;
    const auto transit_ns = transit_.arrived(state.boot_id, state.published_boot_ns, boot_ns(now_ns));
    tools_[wire::text(state.tool)] = {state, {boot_ns(now_ns), transit_ns}};
  });
}

} // namespace bregma::faults
