// The protocol of a range sensor on its serial line: text with a checksum (base/checked_line.hpp).
//
//   from the sensor  $I,<model>,<serial number>,<ADC bits>,<full scale, mV>*..   once after power-on, and when asked
//                    $R,<counter>,<time, us>,<ADC counts>*..                     every millisecond; "-": no reading
//   to the sensor    $?*..                                                       asks for the identity
//
// The counter goes up by one per reading and restarts at power-on, as its clock does.
//
// Pure, any thread, arbitrary bytes.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include <tl/expected.hpp>

namespace bregma::range {

inline constexpr std::size_t kMaxLine = 80; // without its end
inline constexpr std::size_t kMaxWord = 24; // of model and serial number, at least 1

struct Identity {
  std::string model, serial;     // printable, without comma, * and $
  unsigned bits = 10;            // 1 to 24
  unsigned full_scale_mV = 5000; // 1 to 100,000; at 2^bits - 1 counts

  bool operator==(const Identity &) const = default;
};

struct Reading {
  std::uint64_t counter = 0;
  std::uint64_t time_us = 0;           // at most kMaxTime_us
  std::optional<std::uint32_t> counts; // below 2^24; nullopt: the sensor had no reading

  bool operator==(const Reading &) const = default;
};
inline constexpr std::uint64_t kMaxTime_us = 4'000'000'000'000'000; // 126 years

using Message = std::variant<Identity, Reading>;

// With \r\n.
[[nodiscard]] std::string line_of(const Message &message);
[[nodiscard]] std::string identity_question();

// Without the end of the line. The error states the problem of the line.
[[nodiscard]] tl::expected<Message, std::string_view> parse(std::string_view line);
[[nodiscard]] bool is_identity_question(std::string_view line);

} // namespace bregma::range
