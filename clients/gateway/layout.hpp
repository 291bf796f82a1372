// The fields of each record by name: for the JSON form of /state, for the documentation and for tests.
//
// Constant data and pure functions: safe from any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include <nlohmann/json_fwd.hpp>

#include "clients/gateway/records.hpp"

namespace bregma::gateway {

enum class FieldType : std::uint8_t { kF64, kU32, kI32, kChars };

struct FieldLayout {
  std::string_view name;
  FieldType type;
  std::size_t offset; // from the first byte after the record's header
  std::size_t count;  // elements; bytes of kChars
  bool key;           // names the instance
  std::string_view text;
};

struct RecordLayout {
  RecordKind kind;
  std::string_view name;
  std::size_t bytes; // without the record's header; of a field record: without its arrays
  std::string_view text;
  std::span<const FieldLayout> fields;
};

// In the order of RecordKind.
[[nodiscard]] std::span<const RecordLayout> record_layouts();
// Nullptr for a kind that this program does not know.
[[nodiscard]] const RecordLayout *find_layout(std::uint16_t kind);

// One record, its header included, as an object: its kind, "ended" if it has, and its fields; NaN is null. `record` is
// complete. A field record has its arrays too.
[[nodiscard]] nlohmann::json record_json(std::span<const std::byte> record);
// A whole frame. Precondition: made by this program.
[[nodiscard]] nlohmann::json frame_json(std::span<const std::byte> frame);

// The tables of docs/gateway.md.
[[nodiscard]] std::string layout_markdown();

} // namespace bregma::gateway
