#include "server/session/alarm_registry.hpp"

#include <algorithm>
#include <iterator>

#include "idl/names.hpp"

namespace bregma::server {

bool AlarmRegistry::update(const AlarmCondition &condition) {
  const Key key{wire::text(condition.kind), wire::text(condition.subject)};
  const auto found = alarms_.find(key);
  const bool was_active = found != alarms_.end() && found->second.alarm.state != bregma_wire_ALARM_CLEARED;
  if (!condition.active) {
    if (!was_active) {
      return false;
    }
    found->second.alarm.state = bregma_wire_ALARM_CLEARED;
    found->second.alarm.changed_time_ns = condition.time_ns;
    if (found->second.case_closed) {
      end(found);
    } else {
      publish_(found->second.alarm);
    }
    return true;
  }
  wire::Alarm &alarm = alarms_[key].alarm; // value-initialised if it is new
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
  if (found == alarms_.end() || found->second.alarm.state == bregma_wire_ALARM_CLEARED) {
    std::string raised;
    for (const auto &[key, entry] : alarms_) {
      if (entry.alarm.state == bregma_wire_ALARM_RAISED) {
        raised += (raised.empty() ? "" : ", ") + key.first + (key.second.empty() ? "" : " of " + key.second);
      }
    }
    return "no alarm " + name + " is raised; " + (raised.empty() ? "none is" : "raised: " + raised);
  }
  wire::Alarm &alarm = found->second.alarm;
  if (alarm.state == bregma_wire_ALARM_RAISED) { // a repeated acknowledgement has no effect
    alarm.state = bregma_wire_ALARM_ACKNOWLEDGED;
    alarm.changed_time_ns = now_ns;
    publish_(alarm);
  }
  return std::nullopt;
}

void AlarmRegistry::case_closed(std::int64_t now_ns) {
  for (auto entry = alarms_.begin(); entry != alarms_.end();) {
    const auto next = std::next(entry);
    if (entry->second.alarm.state == bregma_wire_ALARM_CLEARED) {
      entry->second.alarm.changed_time_ns = now_ns;
      end(entry);
    } else {
      entry->second.case_closed = true;
    }
    entry = next;
  }
}

void AlarmRegistry::end(std::map<Key, Entry>::iterator entry) {
  entry->second.alarm.ended = true;
  publish_(entry->second.alarm);
  alarms_.erase(entry);
}

bool AlarmRegistry::active(std::string_view kind) const {
  return std::any_of(alarms_.begin(), alarms_.end(), [kind](const auto &entry) {
    return entry.first.first == kind && entry.second.alarm.state != bregma_wire_ALARM_CLEARED;
  });
}

bool AlarmRegistry::unacknowledged(std::string_view kind) const {
  return std::any_of(alarms_.begin(), alarms_.end(), [kind](const auto &entry) {
    return entry.first.first == kind && entry.second.alarm.state == bregma_wire_ALARM_RAISED;
  });
}

} // namespace bregma::server
