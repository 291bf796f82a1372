#include "server/stages/monitoring/alarm_conditions.hpp"

#include "idl/names.hpp"

namespace bregma::server {

std::size_t AlarmConditions::find(const char *kind, std::string_view subject) const noexcept {
  std::size_t i = 0;
  while (i < watched_.size() && (watched_[i].forgotten || watched_[i].kind.name != std::string_view(kind) ||
                                 wire::view(watched_[i].subject) != subject)) {
    ++i;
  }
  return i;
}

void AlarmConditions::update(const Kind &kind, std::string_view subject, bool holds, std::string_view text,
                             std::int64_t now_ns) noexcept {
  if (any_forgotten_) {
    clear_forgotten(now_ns);
  }
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
  (void)watched.latch.update(holds, now_ns);
  const bool raised = watched.latch.raised();
  if (raised != watched.announced && send(watched, raised, raised ? text : "", now_ns)) {
    watched.announced = raised;
  }
  if (!holds && !raised && !watched.announced) {
    remove(at);
  }
}

void AlarmConditions::forget(const char *kind, std::int64_t now_ns) noexcept {
  for (Watched &watched : watched_) {
    watched.forgotten = watched.forgotten || watched.kind.name == std::string_view(kind);
  }
  clear_forgotten(now_ns);
}

void AlarmConditions::clear_forgotten(std::int64_t now_ns) noexcept {
  any_forgotten_ = false;
  for (std::size_t i = watched_.size(); i-- > 0;) {
    if (!watched_[i].forgotten) {
      continue;
    }
    if (!watched_[i].announced || send(watched_[i], false, "", now_ns)) {
      remove(i);
    } else {
      any_forgotten_ = true;
    }
  }
}

void AlarmConditions::remove(std::size_t index) noexcept {
  watched_[index] = watched_.back();
  watched_.pop_back();
}

bool AlarmConditions::send(const Watched &watched, bool active, std::string_view text, std::int64_t now_ns) noexcept {
  AlarmCondition condition{};
  (void)wire::set_name(condition.kind, watched.kind.name);
  (void)wire::set_name(condition.subject, wire::view(watched.subject));
  condition.active = active;
  condition.severity = watched.kind.severity;
  condition.effect = watched.kind.effect;
  condition.time_ns = now_ns;
  wire::set_text(condition.text, text);
  return events_.try_push(condition);
}

} // namespace bregma::server
