// A connection that delays, loses, reorders and duplicates samples.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <limits>
#include <utility>

#include "drivers/sim/random.hpp"
#include "tests/faults/cell.hpp"

namespace bregma::faults {

template <class Sample> class FaultyLink {
public:
  struct Packet {
    Sample sample;
    std::uint64_t writer = 1;
    bool changed = false; // its content is faulty
    std::int64_t due_ns = 0;
  };

  FaultyLink(std::uint64_t seed, const char *stream) : random_(seed, stream) {}

  // fault: nullptr while there is none. fault_s: time since it began.
  void send(Packet packet, std::int64_t now_ns, const LinkFault *fault, double fault_s) {
    packet.due_ns = now_ns;
    if (fault == nullptr) {
      in_order(packet);
      return;
    }
    if (fault->cut || random_.uniform(0.0, 1.0) < fault->loss) {
      return;
    }
    const double delay_ms = fault->delay_ms + fault->ramp_ms_per_s * fault_s;
    const bool after_the_next = random_.uniform(0.0, 1.0) < fault->reordered;
    packet.due_ns += static_cast<std::int64_t>(delay_ms * 1e6);
    for (int copy = 0; copy < fault->copies && !after_the_next; ++copy) {
      in_order(packet);
    }
    // What was held back follows the sample that has overtaken it.
    for (Packet &held : std::exchange(held_back_, {})) {
      held.due_ns = now_ns;
      in_order(held);
    }
    if (after_the_next) {
      held_back_.push_back(packet);
    }
  }

  // Calls visit(packet) for everything that arrives by now.
  template <class Visit> void deliver(std::int64_t now_ns, Visit &&visit) {
    while (!packets_.empty() && packets_.front().due_ns <= now_ns) {
      visit(packets_.front());
      packets_.pop_front();
    }
  }
  // The reader's process is stopped: it keeps the last samples (history depth), and gets them when it continues.
  void keep_last(std::size_t depth, std::int64_t now_ns) {
    const auto due = static_cast<std::size_t>(
        std::count_if(packets_.begin(), packets_.end(), [&](const Packet &one) { return one.due_ns <= now_ns; }));
    for (std::size_t excess = due > depth ? due - depth : 0; excess > 0; --excess) {
      packets_.pop_front();
    }
  }
  void clear() { packets_.clear(); }
  [[nodiscard]] std::int64_t next_due_ns() const {
    return packets_.empty() ? std::numeric_limits<std::int64_t>::max() : packets_.front().due_ns;
  }

private:
  // No packet overtakes an earlier one: a delay that ends lets all of them arrive at once.
  void in_order(Packet packet) {
    packet.due_ns = packets_.empty() ? packet.due_ns : std::max(packet.due_ns, packets_.back().due_ns);
    packets_.push_back(packet);
  }

  sim::Random random_;
  std::deque<Packet> packets_;   // by time of arrival
  std::deque<Packet> held_back_; // until the next one is sent
};

} // namespace bregma::faults
