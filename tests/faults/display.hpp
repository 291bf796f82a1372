// A client of the daemon that shows the tools, as the command line decides what may be shown
// (clients/cli/live_view.hpp). Its link, its clock or its process may be faulty.
#pragma once

#include <cstdint>
#include <string>

#include "clients/cli/live_view.hpp"
#include "tests/faults/cell.hpp"
#include "tests/faults/faulty_link.hpp"

namespace bregma::faults {

class Display {
public:
  static constexpr std::int64_t kPeriod_ns = 10'000'000; // between two pictures

  // cell: nullptr for a client without a fault.
  Display(const Cell *cell, std::uint64_t seed);

  // Samples of the daemon, when they are sent. Times of the fault; 0: not known yet.
  void receive(const wire::NavigationState &state, std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns);
  void receive(const wire::SystemHealth &health, std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns);

  // Draws a picture if one is due: calls shown(tool, number of the frame) for every pose in it.
  template <class Shown> void draw(std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns, Shown &&shown) {
    if (now_ns < next_ns_ || !runs(now_ns, begin_ns, end_ns)) {
      return;
    }
    next_ns_ = now_ns + kPeriod_ns;
    take(now_ns);
    const std::int64_t own_ns = now_ns + clock_error_ns_;
    const cli::DaemonView daemon = cli::view_daemon(snapshot_, own_ns);
    for (const auto &[tool, state] : snapshot_.tools) {
      if (cli::view_tool(state, daemon, own_ns).fresh) {
        shown(tool, state.frame);
      }
    }
  }

private:
  [[nodiscard]] bool runs(std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns) const;
  [[nodiscard]] const LinkFault *link_fault(std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns) const;
  void take(std::int64_t now_ns);

  LinkFault link_;
  ClientFault fault_ = ClientFault::kNone;
  std::int64_t clock_error_ns_ = 0;
  FaultyLink<wire::NavigationState> states_;
  FaultyLink<wire::SystemHealth> health_;
  cli::Snapshot snapshot_;
  std::int64_t next_ns_ = 0;
};

} // namespace bregma::faults
