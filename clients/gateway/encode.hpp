// Records from what the gateway has received of a daemon: which values are current, and when they were measured on the
// gateway's clock.
//
// Threads: one object, one thread.
#pragma once

#include <cstdint>
#include <optional>

#include "clients/gateway/record_store.hpp"
#include "clients/live/snapshot.hpp"

namespace bregma::gateway {

// CLOCK_BOOTTIME as records state it.
[[nodiscard]] constexpr double to_ms(std::int64_t time_ns) { return static_cast<double>(time_ns) * 1e-6; }

// A tool's record. Without a pose if the state must not be shown at now_ns (idl/validity.hpp).
[[nodiscard]] Tool tool_record(const live::Received<wire::NavigationState> &state, bool daemon_alive,
                               std::int64_t now_ns);

class Encoder {
public:
  static constexpr std::int64_t kLinkPeriod_ns = 150'000'000;
  static constexpr std::int64_t kTrackersPeriod_ns = 100'000'000;
  static constexpr std::int64_t kFieldPeriod_ns = 200'000'000;

  explicit Encoder(RecordStore &store) : store_(store) {}

  // After every update of the snapshot, and at least every 50 ms. True if there is news.
  bool encode(const live::Snapshot &snapshot, const live::Now &now);

private:
  struct Context;
  bool encode_link(const Context &context);
  bool encode_tools(const Context &context);
  bool encode_registration(const Context &context);
  bool encode_accuracy(const Context &context);
  bool encode_deformation(const Context &context);
  bool encode_slices(const Context &context);
  bool encode_scanners(const Context &context);
  bool encode_captures(const Context &context);
  bool encode_alarms(const Context &context);
  bool encode_health(const Context &context);
  bool encode_trackers(const Context &context);
  static SliceHeader slice_header(const live::Slice &slice, const Context &context);
  void follow_clock(const live::Snapshot &snapshot);

  RecordStore &store_;
  std::optional<std::int64_t> daemon_clock_ns_; // the daemon's clock minus CLOCK_BOOTTIME of this host, without jitter
  std::uint32_t changes_ = 0;                   // of the daemon that is followed
  std::uint64_t captures_revision_ = 0;
  std::uint64_t field_revision_ = 0;
  std::uint64_t slices_revision_ = 0;
  std::uint32_t presence_ = 0;
  std::int64_t health_ns_ = 0; // arrival of the health that is encoded
  bool health_alive_ = false;
  std::int64_t next_link_ns_ = 0;
  std::int64_t next_trackers_ns_ = 0;
  std::int64_t next_field_ns_ = 0;
};

} // namespace bregma::gateway
