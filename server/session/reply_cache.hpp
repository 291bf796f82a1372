// Received commands and their replies, so that a command that is sent again is not executed again.
// Threads: one at a time.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "idl/topics.hpp"

namespace bregma::server {

// Commands are equal only if they are of one kind and were also sent at the same time, because a restarted client
// counts from one again.
struct Ticket {
  std::string client;
  std::uint64_t id = 0;
  std::int64_t sent_time_ns = 0;
  wire::CommandKind kind = bregma_wire_COMMAND_UNKNOWN;
  [[nodiscard]] bool same_command(const Ticket &other) const {
    return client == other.client && id == other.id && sent_time_ns == other.sent_time_ns && kind == other.kind;
  }
};

class ReplyCache {
public:
  static constexpr std::size_t kKept = 256; // number of answered commands kept, of all clients

  enum class Seen { kNew, kUnderWay, kAnswered };
  // Adds a new command.
  [[nodiscard]] Seen enter(const Ticket &ticket);
  void answer(const Ticket &ticket, const wire::CommandReply &reply);
  // Reply to an answered command.
  [[nodiscard]] const wire::CommandReply &reply(const Ticket &ticket) const;

private:
  struct Entry {
    Ticket ticket;
    std::optional<wire::CommandReply> reply;
  };
  [[nodiscard]] std::deque<Entry>::const_iterator find(const Ticket &ticket) const;
  std::deque<Entry> entries_;
};

} // namespace bregma::server
