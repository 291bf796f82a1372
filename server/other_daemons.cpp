#include "server/other_daemons.hpp"

#include "idl/names.hpp"
#include "server/runtime/clock.hpp"

namespace bregma::server {
namespace {

// Daemons share one instance of the topic: with a depth of 1 the own sample would replace that of another.
wire::Qos with_depth(wire::Qos qos, int depth) {
  qos.depth = depth;
  return qos;
}

std::string name_of(const wire::SystemHealth &health) {
  const std::string process =
      health.process_id != 0 ? "process " + std::to_string(health.process_id) : std::string("a bregmad");
  return process + (health.host[0] != '\0' ? " on " + wire::text(health.host) : "");
}

} // namespace

OtherDaemons::OtherDaemons(const dds::Participant &participant, std::uint64_t own_run_id)
    : reader_(participant, with_depth(wire::Topic<wire::SystemHealth>::kQos, 32)), wait_(participant),
      own_run_id_(own_run_id) {
  wait_.attach(reader_);
}

std::string OtherDaemons::heard(std::int64_t monotonic_ns) {
  reader_.take_each([&](const wire::SystemHealth &health, const dds::SampleInfo &) {
    if (health.run_id != own_run_id_) {
      heard_ns_[name_of(health)] = monotonic_ns;
    }
  });
  std::string names;
  for (auto entry = heard_ns_.begin(); entry != heard_ns_.end();) {
    if (monotonic_ns - entry->second > kPresent_ns) {
      entry = heard_ns_.erase(entry);
    } else {
      names += (names.empty() ? "" : ", ") + entry->first;
      ++entry;
    }
  }
  return names;
}

std::string OtherDaemons::listen(std::chrono::nanoseconds limit) {
  const runtime::SystemClock clock;
  const std::int64_t end_ns = clock.monotonic_ns() + limit.count();
  for (;;) {
    const std::int64_t now_ns = clock.monotonic_ns();
    std::string names = heard(now_ns);
    if (!names.empty() || now_ns >= end_ns) {
      return names;
    }
    (void)reader_.status(); // else the wait set would wake for the same event again and again
    (void)wait_.wait(std::chrono::nanoseconds(end_ns - now_ns));
  }
}

} // namespace bregma::server
