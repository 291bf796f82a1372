// A client of the daemon that shows the tools by the rule for live poses (idl/validity.hpp). Its link, its clock or its
// process may be faulty.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>

#include "idl/validity.hpp"
#include "tests/faults/cell.hpp"
#include "tests/faults/faulty_link.hpp"

namespace bregma::faults {

// Times of the fault; 0: not known yet.
struct FaultTime {
  std::int64_t begin_ns = 0, end_ns = 0;
  [[nodiscard]] bool lasts(std::int64_t now_ns) const { return begin_ns != 0 && now_ns >= begin_ns && now_ns < end_ns; }
};

class Display {
public:
  static constexpr std::int64_t kPeriod_ns = 10'000'000; // between two pictures

  // cell: of a client on another host than the daemon's; nullptr for one on the same host, without a fault.
  Display(const Cell *cell, std::uint64_t seed);

  // When the daemon publishes it.
  void receive(const wire::NavigationState &state, std::int64_t now_ns, const FaultTime &fault);

  // Draws a picture if one is due: calls shown(tool, number of the frame) for every pose in it.
  template <class Shown> void draw(std::int64_t now_ns, const FaultTime &fault, Shown &&shown) {
    if (now_ns < next_ns_ || !runs(now_ns, fault)) {
      return;
    }
    next_ns_ = now_ns + kPeriod_ns;
    take(now_ns);
    for (const auto &[name, tool] : tools_) {
      if (wire::remaining_ns(tool.state, tool.arrival, boot_ns(now_ns)) > 0) {
        shown(name, tool.state.frame);
      }
    }
  }

private:
  struct Tool {
    wire::NavigationState state;
    wire::Arrival arrival;
  };

  [[nodiscard]] bool runs(std::int64_t now_ns, const FaultTime &fault) const;
  // This host's CLOCK_BOOTTIME.
  [[nodiscard]] std::int64_t boot_ns(std::int64_t now_ns) const { return now_ns + daemon_boot_ns_ + boot_lead_ns_; }
  void take(std::int64_t now_ns);

  LinkFault link_;
  ClientFault fault_ = ClientFault::kNone;
  std::int64_t boot_lead_ns_ = 0;   // of this host's clock over the daemon's
  std::int64_t daemon_boot_ns_ = 0; // the daemon's clock minus the true time
  FaultyLink<wire::NavigationState> states_;
  wire::TransitClock transit_;
  std::map<std::string, Tool> tools_;
  std::int64_t next_ns_ = 0;
};

} // namespace bregma::faults
