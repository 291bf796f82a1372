// The conditions that monitoring watches, each with its hysteresis; what changes goes to the session as AlarmCondition.
// One thread; no allocation, no exceptions.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "algorithms/monitoring/alarm_latch.hpp"
#include "server/runtime/spsc_ring.hpp"
#include "server/session/messages.hpp"

namespace bregma::server {

using AlarmEvents = runtime::SpscRing<AlarmCondition, 256>;

class AlarmConditions {
public:
  struct Kind {
    const char *name; // one of alarm::k...
    wire::AlarmSeverity severity;
    SessionEffect effect;
    std::int64_t raise_after_ns;
    std::int64_t clear_after_ns; // below 0: only forget() clears it
  };

  explicit AlarmConditions(AlarmEvents &events) : events_(events) {}

  // text is for a person and is sent when the alarm is raised.
  void update(const Kind &kind, std::string_view subject, bool holds, std::string_view text,
              std::int64_t now_ns) noexcept;
  // The condition has become void: clears it at once if it was raised.
  void forget(const Kind &kind, std::string_view subject, std::int64_t now_ns) noexcept;

private:
  struct Watched {
    const char *kind = nullptr;
    wire::Name subject{};
    monitoring::AlarmLatch latch{0, 0};
  };
  [[nodiscard]] Watched *find(const Kind &kind, std::string_view subject) noexcept;
  void send(const Kind &kind, std::string_view subject, bool active, std::string_view text,
            std::int64_t now_ns) noexcept;

  static constexpr std::size_t kCapacity = 64; // more than all kinds times devices, tools and loops
  std::array<Watched, kCapacity> watched_;
  std::size_t count_ = 0;
  AlarmEvents &events_;
};

} // namespace bregma::server
