// The conditions that monitoring watches, each with its hysteresis. Changes are sent to the session as AlarmCondition.
// One thread; no allocation, no exceptions.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "algorithms/monitoring/alarm_latch.hpp"
#include "server/inputs/unknown_names.hpp"
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
    std::int64_t clear_after_ns; // negative: only forget() clears it
  };

  explicit AlarmConditions(AlarmEvents &events) : events_(events) { watched_.reserve(kExpected); }

  // text: for the operator, sent when the alarm is raised.
  void update(const Kind &kind, std::string_view subject, bool holds, std::string_view text,
              std::int64_t now_ns) noexcept;
  // The conditions of this kind are void for every subject. Raised ones are cleared at once.
  void forget(const char *kind, std::int64_t now_ns) noexcept;
  // Number of conditions that hold or are raised; only these are in the table.
  [[nodiscard]] std::size_t watched() const noexcept { return watched_.size(); }

  // Every kind for every device, tool, reference and unknown name at the same time. More would be watched too, at the
  // price of an allocation.
  static constexpr std::size_t kExpected =
      2 * bregma_wire_MAX_DEVICES + 3 * bregma_wire_MAX_TOOLS + 4 * inputs::UnknownNames::kKept + 8;

private:
  struct Watched {
    Kind kind{};
    wire::Name subject{};
    monitoring::AlarmLatch latch{0, 0};
  };
  // watched() where there is none.
  [[nodiscard]] std::size_t find(const char *kind, std::string_view subject) const noexcept;
  void remove(std::size_t index) noexcept;
  void send(const Kind &kind, std::string_view subject, bool active, std::string_view text,
            std::int64_t now_ns) noexcept;

  std::vector<Watched> watched_;
  AlarmEvents &events_;
};

} // namespace bregma::server
