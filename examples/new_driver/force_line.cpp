#include "force_line.hpp"

#include <charconv>
#include <cmath>

#include "base/text.hpp"

namespace force_line {
namespace {

using bregma::base::parsed_number;

constexpr double kMaxForce_mN = 1e6;
constexpr std::int64_t kMaxTime_us = 4'000'000'000'000'000; // a century, so that ns do not overflow

bool checksum_matches(std::string_view content, std::string_view digits) {
  unsigned expected = 0;
  const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), expected, 16);
  unsigned sum = 0;
  for (const char c : content) {
    sum ^= static_cast<unsigned char>(c);
  }
  return digits.size() == 2 && read.ptr == digits.data() + digits.size() && sum == expected;
}

} // namespace

tl::expected<Reading, std::string_view> parse(std::string_view line) {
  if (line.size() > kMaxLength || !line.starts_with("$FRC,")) {
    return tl::unexpected<std::string_view>("not a line of the sensor");
  }
  const std::size_t star = line.rfind('*');
  if (star == std::string_view::npos || !checksum_matches(line.substr(1, star - 1), line.substr(star + 1))) {
    return tl::unexpected<std::string_view>("wrong checksum");
  }
  const auto fields = bregma::base::cells(line.substr(0, star), ',');
  if (fields.size() != 6) {
    return tl::unexpected<std::string_view>("wrong number of fields");
  }
  const auto counter = parsed_number<std::uint64_t>(fields[1]);
  const auto time_us = parsed_number<std::int64_t>(fields[2]);
  if (!counter || !time_us || *time_us < 0 || *time_us > kMaxTime_us) {
    return tl::unexpected<std::string_view>("counter or time is not a number in range");
  }
  Reading out{*counter, *time_us, {}};
  for (std::size_t i = 0; i < out.force_N.size(); ++i) {
    const auto force_mN = parsed_number<double>(fields[3 + i]);
    if (!force_mN || !(std::abs(*force_mN) <= kMaxForce_mN)) {
      return tl::unexpected<std::string_view>("force is not a number in range");
    }
    out.force_N[i] = *force_mN * 1e-3;
  }
  return out;
}

} // namespace force_line
