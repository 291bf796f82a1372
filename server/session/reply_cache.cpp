#include "server/session/reply_cache.hpp"

#include <algorithm>

namespace bregma::server {

std::deque<ReplyCache::Entry>::const_iterator ReplyCache::find(const Ticket &ticket) const {
  return std::find_if(entries_.begin(), entries_.end(),
                      [&ticket](const Entry &entry) { return entry.ticket.same_command(ticket); });
}

ReplyCache::Seen ReplyCache::enter(const Ticket &ticket) {
  if (const auto found = find(ticket); found != entries_.end()) {
    return found->reply ? Seen::kAnswered : Seen::kUnderWay;
  }
  if (entries_.size() >= kKept) { // the few unanswered ones are among the newest
    entries_.pop_front();
  }
  entries_.push_back({ticket, std::nullopt});
  return Seen::kNew;
}

void ReplyCache::answer(const Ticket &ticket, const wire::CommandReply &reply) {
  if (const auto found = find(ticket); found != entries_.end()) {
    entries_[static_cast<std::size_t>(found - entries_.cbegin())].reply = reply;
  }
}

const wire::CommandReply &ReplyCache::reply(const Ticket &ticket) const { return *find(ticket)->reply; }

} // namespace bregma::server
