// All alarms of a session, with their state, acknowledgement and number of recurrences.
//
//   condition begins -> RAISED -> (operator) ACKNOWLEDGED -> condition ends -> CLEARED -> begins again -> RAISED,
//   count 2
//
// A condition that ends unacknowledged is cleared as well. The registry shows the current state; the count and the
// recording keep the history. An acknowledged alarm that becomes more severe is raised again. The sender applies the
// hysteresis. Threads: one at a time. The caller passes the time.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "server/session/messages.hpp"

namespace bregma::server {

class AlarmRegistry {
public:
  using Publish = std::function<void(const wire::Alarm &)>;
  // publish is called once per change of state, severity or count.
  explicit AlarmRegistry(Publish publish) : publish_(std::move(publish)) {}

  // True if the condition began or ended with this message, false for a repetition.
  bool update(const AlarmCondition &condition);
  // Empty if the alarm was acknowledged, otherwise the reason of the refusal.
  [[nodiscard]] std::optional<std::string> acknowledge(std::string_view kind, std::string_view subject,
                                                       std::int64_t now_ns);
  // The case is closed or replaced. Cleared alarms end now, all others when they are cleared: they are published once
  // more with Alarm::ended, and are no longer in the registry.
  void case_closed(std::int64_t now_ns);
  // Raised or acknowledged, for any subject.
  [[nodiscard]] bool active(std::string_view kind) const;
  // Raised and not acknowledged.
  [[nodiscard]] bool unacknowledged(std::string_view kind) const;

private:
  using Key = std::pair<std::string, std::string>;
  struct Entry {
    wire::Alarm alarm{};
    bool case_closed = false; // since it was raised first
  };
  void end(std::map<Key, Entry>::iterator entry);

  std::map<Key, Entry> alarms_;
  Publish publish_;
};

} // namespace bregma::server
