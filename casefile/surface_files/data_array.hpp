// The numbers in an XML file's arrays: as text, in base64, compressed by zlib. Private to this library.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "casefile/surface_files/number_bytes.hpp"
#include "casefile/surface_files/raw_surface.hpp"

namespace bregma::casefile::detail {

// At least the first `wanted` bytes of a base64 text (RFC 4648), blanks left out; fewer where it ends or another
// character stands. Groups stand for themselves, so texts that were encoded apart and follow each other are read as
// one.
[[nodiscard]] std::string decode_base64(std::string_view text, std::size_t wanted);

// zlib's format (RFC 1950). What is wrong where it is not whole or does not give exactly `size` bytes.
[[nodiscard]] Parsed<std::string> inflated(std::string_view compressed, std::size_t size);

[[nodiscard]] std::vector<double> numbers_of(std::string_view bytes, NumberType type, bool big_endian);

// `count` numbers in words; line: where the text begins; what: their name in a message.
[[nodiscard]] Parsed<std::vector<double>> numbers_in_words(std::string_view text, std::size_t count, int line,
                                                           const std::string &what);

} // namespace bregma::casefile::detail
