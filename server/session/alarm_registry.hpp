// All alarms of a session: what is raised, who has acknowledged, how often it came back.
//
//   condition begins -> RAISED -> (a person) ACKNOWLEDGED -> condition ends -> CLEARED -> begins again -> RAISED, count
//   2
//
// A condition that ends unacknowledged is cleared as well: the board shows the present, the count and the recording
// keep the past. An acknowledged alarm that grows more severe is raised again. Hysteresis is the sender's. Threads: one
// at a time. Time is passed in.
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
  // publish is called once for every change of state, severity or count.
  explicit AlarmRegistry(Publish publish) : publish_(std::move(publish)) {}

  // True when the condition began or ended by this message, false for a repetition.
  bool update(const AlarmCondition &condition);
  // Nothing when it was acknowledged, else the sentence that refuses.
  [[nodiscard]] std::optional<std::string> acknowledge(std::string_view kind, std::string_view subject,
                                                       std::int64_t now_ns);
  // Raised or acknowledged, whatever the subject.
  [[nodiscard]] bool active(std::string_view kind) const;
  // Raised and not acknowledged.
  [[nodiscard]] bool unacknowledged(std::string_view kind) const;

private:
  using Key = std::pair<std::string, std::string>;
  std::map<Key, wire::Alarm> alarms_;
  Publish publish_;
};

} // namespace bregma::server
