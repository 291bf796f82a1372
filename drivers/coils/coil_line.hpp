// The protocol of the coil controller on its serial line: text, one line per message, without a connection.
//
//   to the controller    $SET,<coils, hex>,<current, uA>,<hold, ms>*<checksum>     $OFF*..     $GET*..
//   from the controller  $STA,<counter>,<coils, hex>,<current, uA>,<left, ms>,<lowest, uA>,<highest, uA>,<faults,
//   hex>*..
//
// Bit i: coil i. A negative current is of opposite polarity. Lowest and highest: measured magnitude over the coils that
// are on; faults: coils that are on without current (an open cable). The controller answers every message with its
// state and switches all coils off when `left` has run out. The checksum is two hexadecimal digits: all bytes between $
// and *, combined by exclusive or (as in NMEA 0183).
//
// Pure, any thread, arbitrary bytes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

namespace bregma::coils {

inline constexpr std::size_t kMaxLine = 120; // without its end
inline constexpr std::int64_t kMaxCurrent_uA = 1'000'000;
inline constexpr std::int64_t kMaxHold_ms = 3'600'000;

struct Order {
  enum class Kind { kSet, kOff, kGet } kind = Kind::kGet;
  std::uint64_t coils = 0;
  std::int64_t current_uA = 0;
  std::int64_t hold_ms = 0;
};

struct State {
  std::uint32_t counter = 0; // one up per message
  std::uint64_t coils = 0;
  std::int64_t current_uA = 0;
  std::int64_t left_ms = 0;
  std::int64_t lowest_uA = 0, highest_uA = 0; // 0 <= lowest <= highest
  std::uint64_t faults = 0;                   // a subset of coils
};

// With \r\n.
[[nodiscard]] std::string line_of(const Order &order);
[[nodiscard]] std::string line_of(const State &state);

// Without the end of the line. The error states the problem of the line.
[[nodiscard]] tl::expected<Order, std::string_view> parse_order(std::string_view line);
[[nodiscard]] tl::expected<State, std::string_view> parse_state(std::string_view line);

} // namespace bregma::coils
