// The latest value of every instance, encoded, and what a client has not been sent yet.
//
// A newer value of an instance takes the place of the older one, so the memory does not depend on the clients: a client
// is one number, the version up to which it has everything. One that is slow or stands still misses values and holds
// nothing.
//
// Threads: all members may be called from any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "clients/gateway/records.hpp"

namespace bregma::gateway {

// A record as it is sent, with its header.
struct Record {
  std::vector<std::byte> bytes;
  std::int64_t taken_ns = 0; // CLOCK_BOOTTIME at which its sample was taken from DDS; 0: not measured
};

template <class Body> [[nodiscard]] Record make_record(RecordKind kind, const Body &body, std::int64_t taken_ns = 0) {
  static_assert(sizeof(Body) % 8 == 0);
  Record out{std::vector<std::byte>(sizeof(RecordHeader) + sizeof body), taken_ns};
  const RecordHeader header{static_cast<std::uint16_t>(kind), 0, static_cast<std::uint32_t>(out.bytes.size())};
  std::memcpy(out.bytes.data(), &header, sizeof header);
  std::memcpy(out.bytes.data() + sizeof header, &body, sizeof body);
  return out;
}

// A field's record with its arrays. header states their lengths.
[[nodiscard]] Record make_field_record(const FieldHeader &header, std::span<const float> displacement_mm,
                                       std::span<const float> von_mises_Pa);

// A slice's record with its pixels. header states their number.
[[nodiscard]] Record make_slice_record(const SliceHeader &header, std::span<const std::uint16_t> pixels);

struct FrameRequest {
  std::uint64_t after = 0;                 // the version that the client has
  std::uint32_t number = 1;                // of the frame
  std::int64_t now_ns = 0;                 // CLOCK_BOOTTIME
  bool field = false;                      // with field records
  bool slices = false;                     // with slice records
  std::optional<Pong> pong = std::nullopt; // its written_ms is filled in
};

struct Frame {
  std::vector<std::byte> bytes;
  std::uint64_t up_to = 0;   // the version that the client has after it
  std::int64_t taken_ns = 0; // of its newest tool record that is measured; 0: none
};

class RecordStore {
public:
  // Tools and alarms are sent at once. Other news waits this long for one of them: a frame of its own would delay the
  // tools' next one by the client's period.
  static constexpr std::int64_t kQuiet_ns = 50'000'000;
  // A frame holds at most this and one record; the rest follows in the next one.
  static constexpr std::size_t kMaxFrameBytes = std::size_t{256} << 10;

  // All records of these kinds, at once: changed ones are news, missing ones end. True if anything has changed.
  bool replace(std::span<const RecordKind> kinds, const std::vector<Record> &records);

  // Empty if there is nothing to send yet. A tool whose pose is over by now_ns is sent without it, whatever is stored.
  [[nodiscard]] std::optional<Frame> next(const FrameRequest &request) const;

  // Ended instances that all clients know need no place any more. seen: the lowest version of the clients, or newest().
  void forget_ended(std::uint64_t seen);

  [[nodiscard]] std::uint64_t newest() const;
  // The version that a client has to which the instances of this kind are news, and as little else as possible.
  [[nodiscard]] std::uint64_t before(RecordKind kind) const;
  // Calls visit(record) for every instance of a kind that has not ended.
  void each(RecordKind kind, const std::function<void(std::span<const std::byte>)> &visit) const;
  [[nodiscard]] std::size_t instances() const; // ended ones included

private:
  struct Slot {
    std::string key;
    Record record;
    std::uint64_t version = 0;
    std::int64_t changed_ns = 0;
    bool ended = false;
  };
  using Slots = std::list<Slot>; // in the order of their versions

  bool put(const std::string &key, const Record &record);
  bool end(Slots::iterator slot);
  void renew(Slots::iterator slot);
  [[nodiscard]] bool due(Slots::const_iterator news, std::int64_t now_ns) const;

  mutable std::mutex mutex_;
  Slots slots_;
  std::map<std::string, Slots::iterator> by_key_; // the key begins with the kind: instances of a kind are neighbours
  std::uint64_t newest_ = 0;
};

// The fields of a tool's record that must not be shown once its pose is over: NaN, empty, POSE_STALE.
void blank_pose(Tool &tool);
void blank_poses(RobotTool &tool); // in the base and in the scanner

} // namespace bregma::gateway
