#include "clients/cli/plain_text.hpp"

#include <algorithm>
#include <cmath>

#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

// Bytes of the first character of UTF-8; 0 if it is not valid.
std::size_t character_length(std::string_view text) {
  const auto first = static_cast<unsigned char>(text[0]);
  const std::size_t length = first < 0x80U   ? 1
                             : first < 0xC2U ? 0
                             : first < 0xE0U ? 2
                             : first < 0xF0U ? 3
                             : first < 0xF5U ? 4
                                             : 0;
  const auto continues = [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) == 0x80U; };
  const bool whole = length > 0 && text.size() >= length &&
                     std::all_of(text.begin() + 1, text.begin() + static_cast<std::ptrdiff_t>(length), continues);
  return whole ? length : 0;
}

} // namespace

std::string duration_text(double seconds) {
  if (!std::isfinite(seconds)) {
    return "-";
  }
  if (std::abs(seconds) < 0.9995) {
    return fixed(seconds * 1e3, 0, "ms");
  }
  if (std::abs(seconds) < 59.95) {
    return fixed(seconds, 1, "s");
  }
  const auto whole = std::llround(seconds);
  if (whole < 3600) {
    return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
  }
  return std::to_string(whole / 3600) + " h " + std::to_string(whole / 60 % 60) + " min";
}

std::string space_text(const casefile::RecordingSpace &space) {
  return fixed(static_cast<double>(space.free_bytes) / 1e9, 1, "GB") + " free: " + fixed(space.hours(), 1) +
         " hours of recording at " + fixed(space.bytes_per_s / 1e6, 1, "MB/s");
}

std::string printable(std::string_view text) {
  // A control character of ASCII, or one of C1 in UTF-8.
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = character_length(text.substr(i));
    const auto first = static_cast<unsigned char>(text[i]);
    const bool control = first < 0x20U || first == 0x7FU ||
                         (length == 2 && first == 0xC2U && static_cast<unsigned char>(text[i + 1]) < 0xA0U);
    out += length == 0 || control ? std::string_view("?") : text.substr(i, length);
    i += std::max<std::size_t>(length, 1);
  }
  return out;
}

std::string wrapped(std::string_view text, std::size_t columns) {
  constexpr std::string_view kIndent = "    ";
  constexpr std::size_t kMinColumns = 20; // a narrower terminal is not worth wrapping for
  columns = std::max(columns, kMinColumns);
  std::string out;
  std::size_t column = 0;
  std::size_t space = std::string::npos; // where the present line may be broken, in out
  std::size_t after_space = 0;           // columns of the text after it
  for (const char c : text) {
    const bool starts_character = (static_cast<unsigned char>(c) & 0xC0U) != 0x80U;
    if (starts_character && c != '\n' && column == columns) {
      if (c == ' ') { // the line is full exactly at a word's end
        out += "\n" + std::string(kIndent);
        column = kIndent.size();
        space = std::string::npos;
        continue;
      }
      const bool at_word = space != std::string::npos;
      out.replace(at_word ? space : out.size(), at_word ? 1 : 0, "\n" + std::string(kIndent));
      column = kIndent.size() + (at_word ? after_space : 0);
      space = std::string::npos;
    }
    if (c == '\n') {
      column = 0;
      space = std::string::npos;
    } else {
      column += starts_character ? 1 : 0;
      after_space += starts_character ? 1 : 0;
      if (c == ' ' && column > columns / 2) { // not at the gaps of a table's first columns
        space = out.size();
        after_space = 0;
      }
    }
    out += c;
  }
  return out;
}

} // namespace bregma::cli
