// Lines of serial protocols that carry a checksum, as in NMEA 0183: $<body>*<two hexadecimal digits>, where the digits
// are all bytes of the body combined by exclusive or.
//
// Pure, any thread, arbitrary bytes.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

namespace bregma::base {

enum class LineProblem : unsigned char { kTooLong, kNoFrame, kWrongChecksum };

// With \r\n.
[[nodiscard]] std::string checked_line(std::string_view body);

// The body of a line without its end, which points into `line`. max_length: of the line.
[[nodiscard]] tl::expected<std::string_view, LineProblem> checked_body(std::string_view line, std::size_t max_length);

// Divides a body at its commas; false unless it has exactly N fields.
template <std::size_t N> [[nodiscard]] bool split_fields(std::string_view body, std::array<std::string_view, N> &out) {
  for (std::size_t i = 0; i < N; ++i) {
    const std::size_t comma = body.find(',');
    if ((comma == std::string_view::npos) != (i + 1 == N)) {
      return false;
    }
    out[i] = body.substr(0, comma);
    body = i + 1 == N ? std::string_view() : body.substr(comma + 1);
  }
  return true;
}

} // namespace bregma::base
