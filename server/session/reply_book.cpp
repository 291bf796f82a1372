#include "server/session/reply_book.hpp"

#include <algorithm>

namespace bregma::server {

std::deque<ReplyBook::Entry>::const_iterator ReplyBook::find(const Ticket &ticket) const {
  return std::find_if(entries_.begin(), entries_.end(),
                      [&ticket](const Entry &entry) { return entry.ticket.same_command(ticket); });
}

ReplyBook::Seen ReplyBook::enter(const Ticket &ticket) {
  if (const auto found = find(ticket); found != entries_.end()) {
    return found->reply ? Seen::kAnswered : Seen::kUnderWay;
  }
  if (entries_.size() >= kKept) { // the few under way are among the youngest
    entries_.pop_front();
  }
  entries_.push_back({ticket, std::nullopt});
  return Seen::kNew;
}

void ReplyBook::answer(const Ticket &ticket, const wire::CommandReply &reply) {
  if (const auto found = find(ticket); found != entries_.end()) {
    entries_[static_cast<std::size_t>(found - entries_.cbegin())].reply = reply;
  }
}

const wire::CommandReply &ReplyBook::reply(const Ticket &ticket) const { return *find(ticket)->reply; }

} // namespace bregma::server
