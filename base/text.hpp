// Lines of text files: blanks, cells, numbers.
#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace bregma::base {

// Removes blanks, tabs and carriage returns at both ends.
[[nodiscard]] inline std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  return first == std::string_view::npos ? std::string_view()
                                         : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// The trimmed cells of a line; at least one, which may be empty. They point into `line`.
[[nodiscard]] inline std::vector<std::string_view> cells(std::string_view line, char separator) {
  std::vector<std::string_view> out;
  std::size_t end = 0;
  do {
    end = line.find(separator);
    out.push_back(trimmed(line.substr(0, end)));
    line.remove_prefix(end == std::string_view::npos ? line.size() : end + 1);
  } while (end != std::string_view::npos);
  return out;
}

[[nodiscard]] inline std::string lower(std::string_view text) { // ASCII
  std::string out(text);
  for (char &c : out) {
    c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  }
  return out;
}

// The number that `text` consists of (a double may be infinite or NaN); no result for any other text.
template <class Number> [[nodiscard]] std::optional<Number> parsed_number(std::string_view text) {
  Number value{};
  const char *end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, value);
  return parsed.ec == std::errc() && parsed.ptr == end ? std::optional(value) : std::nullopt;
}

} // namespace bregma::base
