#include "clients/gateway/record_store.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>

#include "clients/gateway/layout.hpp"
#include "idl/boot_clock.hpp"
#include "idl/topics.hpp"

namespace bregma::gateway {
namespace {

RecordHeader header_of(std::span<const std::byte> record) {
  RecordHeader out;
  std::memcpy(&out, record.data(), sizeof out);
  return out;
}

std::string prefix_of(RecordKind kind) {
  const auto number = static_cast<std::uint16_t>(kind);
  return {static_cast<char>(number >> 8), static_cast<char>(number & 0xff)};
}

// Kind and key fields.
std::string key_of(std::span<const std::byte> record) {
  const RecordLayout *layout = find_layout(header_of(record).kind);
  std::string out = prefix_of(layout->kind);
  for (const FieldLayout &field : layout->fields) {
    if (field.key) {
      const auto *at = reinterpret_cast<const char *>(record.data()) + sizeof(RecordHeader) + field.offset;
      out.append(at, field.type == FieldType::kChars ? field.count : sizeof(double));
    }
  }
  return out;
}

void append(std::vector<std::byte> &out, std::span<const std::byte> bytes) {
  const std::size_t at = out.size();
  out.resize(at + bytes.size());
  std::memcpy(out.data() + at, bytes.data(), bytes.size());
}

// A record may wait here for a client that is slow to acknowledge.
template <class Body, class Blank> void blank_if_over(std::byte *record, std::int64_t now_ns, Blank &&blank) {
  Body tool;
  std::memcpy(&tool, record + sizeof(RecordHeader), sizeof tool);
  if (!std::isnan(tool.valid_until_ms) && tool.valid_until_ms <= static_cast<double>(now_ns) * 1e-6) {
    blank(tool);
    std::memcpy(record + sizeof(RecordHeader), &tool, sizeof tool);
  }
}

// Zeros up to a multiple of 8 bytes, and the length of the whole in the record's header.
void close_record(Record &record) {
  record.bytes.resize((record.bytes.size() + 7) / 8 * 8);
  RecordHeader begin = header_of(record.bytes);
  begin.bytes = static_cast<std::uint32_t>(record.bytes.size());
  std::memcpy(record.bytes.data(), &begin, sizeof begin);
}

} // namespace

Record make_slice_record(const SliceHeader &header, std::span<const std::uint16_t> pixels) {
  Record out = make_record(RecordKind::kSlice, header);
  append(out.bytes, std::as_bytes(pixels));
  close_record(out);
  return out;
}

Record make_field_record(const FieldHeader &header, std::span<const float> displacement_mm,
                         std::span<const float> von_mises_Pa) {
  Record out = make_record(RecordKind::kField, header);
  for (const auto &array : {displacement_mm, von_mises_Pa}) {
    append(out.bytes, std::as_bytes(array));
  }
  close_record(out);
  return out;
}

void blank_pose(Tool &tool) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  if (tool.status == bregma_wire_POSE_LIVE || tool.status == bregma_wire_POSE_UNVERIFIED) {
    tool.status = bregma_wire_POSE_STALE;
  }
  tool.valid_until_ms = kUnknown;
  std::fill_n(reinterpret_cast<double *>(reinterpret_cast<std::byte *>(&tool) + offsetof(Tool, rotation)),
              (offsetof(Tool, trajectory) - offsetof(Tool, rotation)) / sizeof(double), kUnknown);
  tool.distance_to_target_mm = tool.lateral_deviation_mm = tool.angle_rad = tool.remaining_depth_mm = kUnknown;
  std::fill_n(tool.predicted_target_mm, 3, kUnknown);
  tool.distance_to_predicted_target_mm = kUnknown;
  std::memset(tool.nearest_structure, 0, sizeof tool.nearest_structure);
  tool.nearest_structure_mm = tool.nearest_structure_sigma_mm = kUnknown;
}

void blank_poses(RobotTool &tool) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  for (std::int32_t *status : {&tool.status, &tool.scanner_status}) {
    *status = *status == bregma_wire_POSE_LIVE ? bregma_wire_POSE_STALE : *status;
  }
  tool.valid_until_ms = kUnknown;
  std::fill(std::begin(tool.rotation), std::end(tool.rotation), kUnknown);
  std::fill(std::begin(tool.tip_mm), std::end(tool.tip_mm), kUnknown);
  std::fill(std::begin(tool.covariance), std::end(tool.covariance), kUnknown);
  std::fill(std::begin(tool.scanner_rotation), std::end(tool.scanner_rotation), kUnknown);
  std::fill(std::begin(tool.scanner_tip_mm), std::end(tool.scanner_tip_mm), kUnknown);
  std::fill(std::begin(tool.scanner_covariance), std::end(tool.scanner_covariance), kUnknown);
  tool.scanner_error_95_mm = kUnknown;
}

void RecordStore::renew(Slots::iterator slot) {
  slot->version = ++newest_;
  slot->changed_ns = wire::boot_now_ns();
  slots_.splice(slots_.end(), slots_, slot);
}

bool RecordStore::put(const std::string &key, const Record &record) {
  const auto found = by_key_.find(key);
  if (found == by_key_.end()) {
    slots_.push_back({key, record, ++newest_, wire::boot_now_ns(), false});
    by_key_.emplace(key, std::prev(slots_.end()));
    return true;
  }
  const auto slot = found->second;
  if (!slot->ended && slot->record.bytes == record.bytes) {
    return false;
  }
  slot->record = record;
  slot->ended = false;
  renew(slot);
  return true;
}

bool RecordStore::end(Slots::iterator slot) {
  if (slot->ended) {
    return false;
  }
  auto &bytes = slot->record.bytes;
  RecordHeader header = header_of(bytes);
  const RecordLayout *layout = find_layout(header.kind);
  bytes.resize(sizeof(RecordHeader) + layout->bytes); // without the arrays of a field
  header.flags = kEnded;
  header.bytes = static_cast<std::uint32_t>(bytes.size());
  std::vector<std::byte> last(bytes.size());
  std::memcpy(last.data(), &header, sizeof header);
  for (const FieldLayout &field : layout->fields) {
    if (field.key) {
      const std::size_t at = sizeof(RecordHeader) + field.offset;
      std::memcpy(last.data() + at, bytes.data() + at, field.type == FieldType::kChars ? field.count : sizeof(double));
    }
  }
  slot->record = {std::move(last), 0};
  slot->ended = true;
  renew(slot);
  return true;
}

bool RecordStore::replace(std::span<const RecordKind> kinds, const std::vector<Record> &records) {
  const std::lock_guard lock(mutex_);
  bool changed = false;
  std::set<std::string> present;
  for (const Record &record : records) {
    const std::string key = key_of(record.bytes);
    changed |= put(key, record);
    present.insert(key);
  }
  for (const RecordKind kind : kinds) {
    const std::string prefix = prefix_of(kind);
    for (auto it = by_key_.lower_bound(prefix); it != by_key_.end() && it->first.starts_with(prefix); ++it) {
      if (!present.contains(it->first)) {
        changed |= end(it->second);
      }
    }
  }
  return changed;
}

// news: the oldest of it.
bool RecordStore::due(Slots::const_iterator news, std::int64_t now_ns) const {
  if (news == slots_.end() || now_ns - news->changed_ns >= kQuiet_ns) {
    return true;
  }
  return std::any_of(news, slots_.end(), [](const Slot &slot) {
    const auto kind = static_cast<RecordKind>(header_of(slot.record.bytes).kind);
    return kind == RecordKind::kTool || kind == RecordKind::kRobotTool || kind == RecordKind::kAlarm;
  });
}

std::optional<Frame> RecordStore::next(const FrameRequest &request) const {
  const std::lock_guard lock(mutex_);
  auto slot = slots_.end();
  while (slot != slots_.begin() && std::prev(slot)->version > request.after) {
    --slot;
  }
  if (!request.pong && request.after > 0 && !due(slot, request.now_ns)) {
    return std::nullopt;
  }
  Frame out;
  out.up_to = request.after;
  FrameHeader header{kFrameMagic, kLayoutVersion, 0, request.number, 0, static_cast<double>(request.now_ns) * 1e-6};
  append(out.bytes, std::as_bytes(std::span(&header, 1)));
  if (request.pong) {
    Pong pong = *request.pong;
    pong.written_ms = header.written_ms;
    const Record record = make_record(RecordKind::kPong, pong);
    append(out.bytes, record.bytes);
    ++header.records;
  }
  constexpr std::uint16_t kMaxRecords = std::numeric_limits<std::uint16_t>::max();
  for (; slot != slots_.end() && out.bytes.size() < kMaxFrameBytes && header.records < kMaxRecords; ++slot) {
    out.up_to = slot->version;
    const auto kind = static_cast<RecordKind>(header_of(slot->record.bytes).kind);
    // To a client that has nothing yet, an instance that has ended is no news.
    if ((kind == RecordKind::kField && !request.field) || (kind == RecordKind::kSlice && !request.slices) ||
        (slot->ended && request.after == 0)) {
      continue;
    }
    const std::size_t at = out.bytes.size();
    append(out.bytes, slot->record.bytes);
    if (kind == RecordKind::kTool && !slot->ended) {
      blank_if_over<Tool>(out.bytes.data() + at, request.now_ns, blank_pose);
      out.taken_ns = std::max(out.taken_ns, slot->record.taken_ns);
    } else if (kind == RecordKind::kRobotTool && !slot->ended) {
      blank_if_over<RobotTool>(out.bytes.data() + at, request.now_ns, blank_poses);
    }
    ++header.records;
  }
  if (header.records == 0) {
    return std::nullopt;
  }
  header.bytes = static_cast<std::uint32_t>(out.bytes.size());
  std::memcpy(out.bytes.data(), &header, sizeof header);
  return out;
}

void RecordStore::forget_ended(std::uint64_t seen) {
  const std::lock_guard lock(mutex_);
  for (auto slot = slots_.begin(); slot != slots_.end() && slot->version <= seen;) {
    if (slot->ended) {
      by_key_.erase(slot->key);
      slot = slots_.erase(slot);
    } else {
      ++slot;
    }
  }
}

std::uint64_t RecordStore::newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

std::uint64_t RecordStore::before(RecordKind kind) const {
  const std::lock_guard lock(mutex_);
  const std::string prefix = prefix_of(kind);
  std::uint64_t lowest = newest_;
  for (auto it = by_key_.lower_bound(prefix); it != by_key_.end() && it->first.starts_with(prefix); ++it) {
    lowest = std::min(lowest, it->second->version - 1);
  }
  return std::max<std::uint64_t>(lowest, 1); // 0 would be a client that has nothing
}

void RecordStore::each(RecordKind kind, const std::function<void(std::span<const std::byte>)> &visit) const {
  const std::lock_guard lock(mutex_);
  const std::string prefix = prefix_of(kind);
  for (auto it = by_key_.lower_bound(prefix); it != by_key_.end() && it->first.starts_with(prefix); ++it) {
    if (!it->second->ended) {
      visit(it->second->record.bytes);
    }
  }
}

std::size_t RecordStore::instances() const {
  const std::lock_guard lock(mutex_);
  return slots_.size();
}

} // namespace bregma::gateway
