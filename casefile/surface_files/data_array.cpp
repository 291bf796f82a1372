#include "casefile/surface_files/data_array.hpp"

#include <limits>

#include <zlib.h>

#include "casefile/surface_files/text_cursor.hpp"

namespace bregma::casefile::detail {

namespace {

// Deflate compresses by at most 1032 to 1 (zlib's technical notes). A file that claims more is rejected before it is
// unpacked.
constexpr std::size_t kMaxCompression = 1100;

int base64_value(char c) {
  if (c >= 'A' && c <= 'Z') {
    return c - 'A';
  }
  if (c >= 'a' && c <= 'z') {
    return c - 'a' + 26;
  }
  if (c >= '0' && c <= '9') {
    return c - '0' + 52;
  }
  return c == '+' ? 62 : c == '/' ? 63 : -1;
}

} // namespace

std::string decode_base64(std::string_view text, std::size_t wanted) {
  std::string out;
  out.reserve(std::min(wanted, text.size()) + 3);
  std::uint32_t group = 0;
  int digits = 0;
  int padding = 0;
  for (const char c : text) {
    if (c == ' ' || c == '\n' || c == '\r' || c == '\t') {
      continue;
    }
    const int value = base64_value(c);
    if (value < 0 && (c != '=' || digits < 2)) {
      break;
    }
    padding += c == '=' ? 1 : 0;
    group = (group << 6U) | static_cast<std::uint32_t>(std::max(value, 0));
    if (++digits < 4) {
      continue;
    }
    for (int byte = 0; byte < 3 - padding; ++byte) {
      out.push_back(static_cast<char>((group >> (16U - 8U * static_cast<unsigned>(byte))) & 0xFFU));
    }
    if (out.size() >= wanted) {
      break;
    }
    group = 0;
    digits = 0;
    padding = 0;
  }
  return out;
}

Parsed<std::string> inflated(std::string_view compressed, std::size_t size) {
  if (size / kMaxCompression > compressed.size()) {
    return wrong(std::to_string(compressed.size()) + " compressed bytes cannot hold " + std::to_string(size));
  }
  std::string out(size, '\0');
  auto produced = static_cast<uLongf>(size);
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): zlib's own type of bytes
  const int status = uncompress(reinterpret_cast<Bytef *>(out.data()), &produced,
                                reinterpret_cast<const Bytef *>(compressed.data()), compressed.size()); // NOLINT
  if (status != Z_OK || produced != size) {
    return wrong("the compressed data are damaged or end early");
  }
  return out;
}

std::vector<double> numbers_of(std::string_view bytes, NumberType type, bool big_endian) {
  const std::size_t size = size_of(type);
  std::vector<double> out;
  out.reserve(bytes.size() / size);
  for (std::size_t at = 0; at + size <= bytes.size(); at += size) {
    out.push_back(load_number(bytes.data() + at, type, big_endian));
  }
  return out;
}

Parsed<std::vector<double>> numbers_in_words(std::string_view text, std::size_t count, int line,
                                             const std::string &what) {
  std::vector<double> out;
  TextCursor cursor(text, line);
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = cursor.number(what + ": number " + std::to_string(i));
    if (!value) {
      return tl::unexpected(value.error());
    }
    out.push_back(*value);
  }
  if (!cursor.word().empty()) {
    return wrong_line(cursor.line(), what + " has more than " + std::to_string(count) + " numbers");
  }
  return out;
}

} // namespace bregma::casefile::detail
