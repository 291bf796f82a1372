// Messages from one thread that may wait to one that must not: a ring, and behind it a backlog for what does not fit,
// so that order is kept and nothing is lost.
//
// Threads: send, flush and waiting by the sender; take_each by the receiver, wait-free.
#pragma once

#include <cstddef>
#include <deque>

#include "server/runtime/spsc_ring.hpp"

namespace bregma::runtime {

template <class Message, std::size_t Capacity> class Mailbox {
public:
  using Content = Message;

  void send(const Message &message) {
    flush();
    if (!backlog_.empty() || ring_.size() == Capacity || !ring_.try_push(message)) {
      backlog_.push_back(message);
    }
  }
  // Moves what waits in the backlog into the ring, as far as there is room. Call now and then.
  void flush() {
    while (!backlog_.empty() && ring_.size() < Capacity && ring_.try_push(backlog_.front())) {
      backlog_.pop_front();
    }
  }

  template <class Visit> void take_each(Visit &&visit) noexcept {
    Message message;
    while (ring_.try_pop(message)) {
      visit(message);
    }
  }

private:
  SpscRing<Message, Capacity> ring_;
  std::deque<Message> backlog_; // the sender's
};

} // namespace bregma::runtime
