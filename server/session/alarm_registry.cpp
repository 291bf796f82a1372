#include "server/session/alarm_registry.hpp"

#include <algorithm>

#include "idl/names.hpp"

namespace bregma::server {

bool AlarmRegistry::update(const AlarmCondition &condition) {
  const Key key{wire::text(condition.kind), wire::text(condition.subject)};
  const auto found = alarms_.find(key);
  const bool was_active = found != alarms_.end() && found->second.state != bregma_wire_ALARM_CLEARED;
  if (!condition.active) {
    if (!was_active) {
      return false;
    }
    found->second.state = bregma_wire_ALARM_CLEARED;
    found->second.changed_time_ns = condition.time_ns;
    publish_(found->second);
    return true;
  }
  wire::Alarm &alarm = alarms_[key]; // value-initialised if it is new
  if (was_active && condition.severity <= alarm.severity) {
    return false;
  }
  std::copy(std::begin(condition.kind), std::end(condition.kind), alarm.kind);
  std::copy(std::begin(condition.subject), std::end(condition.subject), alarm.subject);
  alarm.state = bregma_wire_ALARM_RAISED;
  alarm.severity = condition.severity;
  alarm.changed_time_ns = condition.time_ns;
  wire::set_text(alarm.text, {condition.text, strnlen(condition.text, sizeof(condition.text))});
  if (!was_active) {
    alarm.raised_time_ns = condition.time_ns;
    ++alarm.count;
  }
  publish_(alarm);
  return !was_active;
}

std::optional<std::string> AlarmRegistry::acknowledge(std::string_view kind, std::string_view subject,
                                                      std::int64_t now_ns) {
  const std::string name = std::string(kind) + (subject.empty() ? "" : " of " + std::string(subject));
  const auto found = alarms_.find(Key(kind, subject));
  if (found == alarms_.end() || found->second.state == bregma_wire_ALARM_CLEARED) {
    std::string raised;
    for (const auto &[key, alarm] : alarms_) {
      if (alarm.state == bregma_wire_ALARM_RAISED) {
        raised += (raised.empty() ? "" : ", ") + key.first + (key.second.empty() ? "" : " of " + key.second);
      }
    }
    return "no alarm " + name + " is raised; " + (raised.empty() ? "none is" : "raised: " + raised);
  }
  if (found->second.state == bregma_wire_ALARM_RAISED) { // a repeated acknowledgement has no effect
    found->second.state = bregma_wire_ALARM_ACKNOWLEDGED;
    found->second.changed_time_ns = now_ns;
    publish_(found->second);
  }
  return std::nullopt;
}

bool AlarmRegistry::active(std::string_view kind) const {
  return std::any_of(alarms_.begin(), alarms_.end(), [kind](const auto &entry) {
    return entry.first.first == kind && entry.second.state != bregma_wire_ALARM_CLEARED;
  });
}

bool AlarmRegistry::unacknowledged(std::string_view kind) const {
  return std::any_of(alarms_.begin(), alarms_.end(), [kind](const auto &entry) {
    return entry.first.first == kind && entry.second.state == bregma_wire_ALARM_RAISED;
  });
}

} // namespace bregma::server
