// The protocol of the force sensor: bytes to readings, without a connection. One line per reading,
//
//   $FRC,<counter>,<device time, us>,<x, mN>,<y, mN>,<z, mN>*<checksum>
//
// where the checksum is two hexadecimal digits: all bytes between $ and *, combined by exclusive or (as in NMEA 0183).
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include <tl/expected.hpp>

namespace force_line {

inline constexpr std::size_t kMaxLength = 120; // maximal length of a line, without its end

struct Reading {
  std::uint64_t counter;
  std::int64_t time_us;
  std::array<double, 3> force_N;
};

// The error states the problem of the line.
[[nodiscard]] tl::expected<Reading, std::string_view> parse(std::string_view line);

} // namespace force_line
