#include "server/stages/monitoring/alarm_conditions.hpp"

#include "idl/names.hpp"

namespace bregma::server {

AlarmConditions::Watched *AlarmConditions::find(const Kind &kind, std::string_view subject) noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    if (watched_[i].kind == std::string_view(kind.name) && wire::view(watched_[i].subject) == subject) {
      return &watched_[i];
    }
  }
  if (count_ == watched_.size()) {
    return nullptr;
  }
  Watched &fresh = watched_[count_++];
  fresh.kind = kind.name;
  (void)wire::set_name(fresh.subject, subject);
  fresh.latch = monitoring::AlarmLatch(kind.raise_after_ns, kind.clear_after_ns);
  return &fresh;
}

void AlarmConditions::update(const Kind &kind, std::string_view subject, bool holds, std::string_view text,
                             std::int64_t now_ns) noexcept {
  Watched *watched = find(kind, subject);
  if (watched == nullptr) {
    return;
  }
  switch (watched->latch.update(holds, now_ns)) {
  case monitoring::AlarmLatch::Change::kRaised:
    send(kind, subject, true, text, now_ns);
    break;
  case monitoring::AlarmLatch::Change::kCleared:
    send(kind, subject, false, text, now_ns);
    break;
  case monitoring::AlarmLatch::Change::kNone:
    break;
  }
}

void AlarmConditions::forget(const Kind &kind, std::string_view subject, std::int64_t now_ns) noexcept {
  Watched *watched = find(kind, subject);
  if (watched == nullptr) {
    return;
  }
  if (watched->latch.raised()) {
    send(kind, subject, false, "", now_ns);
  }
  watched->latch.reset();
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
  (void)events_.try_push(condition); // a full ring counts what it drops
}

} // namespace bregma::server
