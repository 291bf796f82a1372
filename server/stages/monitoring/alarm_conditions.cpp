#include "server/stages/monitoring/alarm_conditions.hpp"

#include "idl/names.hpp"

namespace bregma::server {

std::size_t AlarmConditions::find(const char *kind, std::string_view subject) const noexcept {
  std::size_t i = 0;
  while (i < watched_.size() &&
         (watched_[i].kind.name != std::string_view(kind) || wire::view(watched_[i].subject) != subject)) {
    ++i;
  }
  return i;
}

void AlarmConditions::update(const Kind &kind, std::string_view subject, bool holds, std::string_view text,
                             std::int64_t now_ns) noexcept {
  const std::size_t at = find(kind.name, subject);
  if (at == watched_.size()) {
    if (!holds) {
      return;
    }
    Watched &fresh = watched_.emplace_back();
    fresh.kind = kind;
    (void)wire::set_name(fresh.subject, subject);
    fresh.latch = monitoring::AlarmLatch(kind.raise_after_ns, kind.clear_after_ns);
  }
  Watched &watched = watched_[at];
  switch (watched.latch.update(holds, now_ns)) {
  case monitoring::AlarmLatch::Change::kRaised:
    send(kind, subject, true, text, now_ns);
    break;
  case monitoring::AlarmLatch::Change::kCleared:
    send(kind, subject, false, text, now_ns);
    break;
  case monitoring::AlarmLatch::Change::kNone:
    break;
  }
  if (!holds && !watched.latch.raised()) {
    remove(at);
  }
}

void AlarmConditions::forget(const char *kind, std::int64_t now_ns) noexcept {
  for (std::size_t i = watched_.size(); i-- > 0;) {
    if (watched_[i].kind.name != std::string_view(kind)) {
      continue;
    }
    if (watched_[i].latch.raised()) {
      send(watched_[i].kind, wire::view(watched_[i].subject), false, "", now_ns);
    }
    remove(i);
  }
}

void AlarmConditions::remove(std::size_t index) noexcept {
  watched_[index] = watched_.back();
  watched_.pop_back();
}

void AlarmConditions::send(const Kind &kind, std::string_view subject, bool active, std::string_view text,
                           std::int64_t now_ns) noexcept {
  AlarmCondition condition{};
  (void)wire::set_name(condition.kind, kind.name);
  (void)wire::set_name(condition.subject, subject);
  condition.active = active;
  condition.severity = kind.severity;
  condition.effect = kind.effect;
  condition.time_ns = now_ns;
  wire::set_text(condition.text, text);
  (void)events_.try_push(condition); // a full ring counts dropped values
}

} // namespace bregma::server
