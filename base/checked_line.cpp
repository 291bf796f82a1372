#include "base/checked_line.hpp"

#include <charconv>
#include <cstdio>

namespace bregma::base {
namespace {

unsigned checksum(std::string_view body) {
  unsigned sum = 0;
  for (const char c : body) {
    sum ^= static_cast<unsigned char>(c);
  }
  return sum;
}

} // namespace

std::string checked_line(std::string_view body) {
  char end[8];
  std::snprintf(end, sizeof end, "*%02X\r\n", checksum(body));
  return "$" + std::string(body) + end;
}

tl::expected<std::string_view, LineProblem> checked_body(std::string_view line, std::size_t max_length) {
  if (line.size() > max_length) {
    return tl::unexpected(LineProblem::kTooLong);
  }
  if (line.size() < 4 || line.front() != '$' || line[line.size() - 3] != '*') {
    return tl::unexpected(LineProblem::kNoFrame);
  }
  unsigned stated = 0;
  const std::string_view body = line.substr(1, line.size() - 4);
  const std::string_view digits = line.substr(line.size() - 2);
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), stated, 16);
  if (error != std::errc() || end != digits.data() + digits.size() || stated != checksum(body)) {
    return tl::unexpected(LineProblem::kWrongChecksum);
  }
  return body;
}

} // namespace bregma::base
