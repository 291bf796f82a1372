// The numbers in an XML file's arrays: as text, in base64, compressed by zlib. Private to this library.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "casefile/surface_files/number_bytes.hpp"
#include "casefile/surface_files/raw_surface.hpp"

namespace bregma::casefile::detail {

// At least the first `wanted` bytes of a base64 text [RFC 4648], without blanks; fewer where it ends or has an invalid
// character. Groups are independent, so that consecutive texts that were encoded separately are read as one.
[[nodiscard]] std::string decode_base64(std::string_view text, std::size_t wanted);

// zlib's format [RFC 1950]. An error where it is incomplete or does not expand to exactly `size` bytes.
[[nodiscard]] Parsed<std::string> inflated(std::string_view compressed, std::size_t size);

[[nodiscard]] std::vector<double> numbers_of(std::string_view bytes, NumberType type, bool big_endian);

// `count` numbers from words; line: line of the text's begin; what: their name in a message.
[[nodiscard]] Parsed<std::vector<double>> numbers_in_words(std::string_view text, std::size_t count, int line,
                                                           const std::string &what);

} // namespace bregma::casefile::detail
