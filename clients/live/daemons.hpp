// The daemons that speak on a domain. Normally there is one. If there are more, a client shows the one that it heard
// first until that one is lost, and never mixes them.
//
// Threads: one. No DDS and no clock: the caller states who was heard and when.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "clients/live/snapshot.hpp"
#include "idl/dds.hpp"

namespace bregma::live {

class Daemons {
public:
  explicit Daemons(const std::array<std::uint8_t, 16> &own_boot_id) : own_boot_id_(own_boot_id) {}

  struct Speaker {
    Snapshot said;
    wire::TransitClock transit;
    std::int64_t first_heard_ns = 0;
    std::int64_t heard_ns = 0;

    // Records the arrival of a sample that the daemon published at these times of its clock.
    [[nodiscard]] wire::Arrival arrived(const wire::BootId &boot_id, std::int64_t published_boot_ns,
                                        std::int64_t published_utc_ns, const Now &now);
  };

  // Where to keep a sample of this participant, received now.
  [[nodiscard]] Speaker &heard(const dds::Guid &participant, std::int64_t now_boot_ns);

  // After samples were received, and at times without any: decides who is followed.
  // writers_alive: DDS knows a living writer of SystemHealth.
  void choose(bool writers_alive, std::int64_t now_boot_ns);

  // An empty one before the first daemon.
  [[nodiscard]] Snapshot &followed();
  [[nodiscard]] const std::optional<dds::Guid> &followed_participant() const { return followed_; }
  // Participants that also wrote the daemon's topics within the last seconds.
  [[nodiscard]] std::vector<dds::Guid> others(std::int64_t now_boot_ns) const;

private:
  std::array<std::uint8_t, 16> own_boot_id_;
  std::map<dds::Guid, Speaker> speakers_;
  std::optional<dds::Guid> followed_;
  Snapshot nothing_;
};

} // namespace bregma::live
