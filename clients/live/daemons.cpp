#include "clients/live/daemons.hpp"

#include <algorithm>

namespace bregma::live {
namespace {

constexpr std::int64_t kForgotten_ns =
    10'000'000'000; // a silent speaker that is not followed is removed after this time

constexpr std::int64_t kMaxTime_ns = 4'000'000'000'000'000'000; // the year 2096: differences do not overflow

} // namespace

wire::Arrival Daemons::Speaker::arrived(const wire::BootId &boot_id, std::int64_t published_boot_ns,
                                        std::int64_t published_utc_ns, const Now &now) {
  const wire::Arrival arrival{now.boot_ns, transit.arrived(boot_id, published_boot_ns, now.boot_ns)};
  const std::int64_t daemon_now_ns =
      std::clamp<std::int64_t>(published_utc_ns, 0, kMaxTime_ns) + arrival.transit_ns.value_or(0);
  said.daemon_clock_ns = daemon_now_ns - now.boot_ns;
  said.clock_difference_ns = now.utc_ns - daemon_now_ns;
  return arrival;
}

Daemons::Speaker &Daemons::heard(const dds::Guid &participant, std::int64_t now_boot_ns) {
  const auto [found, is_new] =
      speakers_.try_emplace(participant, Speaker{{}, wire::TransitClock(own_boot_id_), now_boot_ns, now_boot_ns});
  found->second.heard_ns = now_boot_ns;
  return found->second;
}

void Daemons::choose(bool writers_alive, std::int64_t now_boot_ns) {
  std::erase_if(speakers_, [&](const auto &entry) {
    return entry.first != followed_ && now_boot_ns - entry.second.heard_ns > kForgotten_ns;
  });
  if (followed_) {
    speakers_.at(*followed_).said.no_writer = !writers_alive;
    if (alive(followed(), now_boot_ns)) {
      return;
    }
  }
  std::optional<dds::Guid> first;
  for (const auto &[participant, speaker] : speakers_) {
    const bool earlier = !first || speaker.first_heard_ns < speakers_.at(*first).first_heard_ns;
    if (participant != followed_ && writers_alive && earlier && alive(speaker.said, now_boot_ns)) {
      first = participant;
    }
  }
  if (first) {
    const std::uint32_t changes = followed_ ? followed().changes + 1 : 0;
    followed_ = first;
    followed().changes = changes;
  }
}

Snapshot &Daemons::followed() { return followed_ ? speakers_.at(*followed_).said : nothing_; }

std::vector<dds::Guid> Daemons::others(std::int64_t now_boot_ns) const {
  std::vector<dds::Guid> out;
  for (const auto &[participant, speaker] : speakers_) {
    if (participant != followed_ && now_boot_ns - speaker.heard_ns < kDaemonSilent_ns) {
      out.push_back(participant);
    }
  }
  return out;
}

} // namespace bregma::live
