// Numbers in binary files of either byte order. Private to this library.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>

namespace bregma::casefile::detail {

static_assert(std::endian::native == std::endian::little, "what is swapped below is big-endian");

enum class NumberType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kInt64, kUint64, kFloat, kDouble };

[[nodiscard]] constexpr std::size_t size_of(NumberType type) {
  constexpr std::array<std::size_t, 10> kSizes{1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}

// bytes must hold sizeof(T).
template <class T> [[nodiscard]] T load(const char *bytes, bool big_endian) {
  std::array<char, sizeof(T)> raw;
  std::copy_n(bytes, sizeof(T), raw.begin());
  if (big_endian) {
    std::reverse(raw.begin(), raw.end());
  }
  return std::bit_cast<T>(raw);
}

// bytes must hold size_of(type). Whole numbers beyond 2^53 lose precision; none of these files contains any.
[[nodiscard]] inline double load_number(const char *bytes, NumberType type, bool big_endian) {
  switch (type) {
  case NumberType::kInt8:
    return load<std::int8_t>(bytes, big_endian);
  case NumberType::kUint8:
    return load<std::uint8_t>(bytes, big_endian);
  case NumberType::kInt16:
    return load<std::int16_t>(bytes, big_endian);
  case NumberType::kUint16:
    return load<std::uint16_t>(bytes, big_endian);
  case NumberType::kInt32:
    return load<std::int32_t>(bytes, big_endian);
  case NumberType::kUint32:
    return load<std::uint32_t>(bytes, big_endian);
  case NumberType::kInt64:
    return static_cast<double>(load<std::int64_t>(bytes, big_endian));
  case NumberType::kUint64:
    return static_cast<double>(load<std::uint64_t>(bytes, big_endian));
  case NumberType::kFloat:
    return load<float>(bytes, big_endian);
  case NumberType::kDouble:
    break;
  }
  return load<double>(bytes, big_endian);
}

} // namespace bregma::casefile::detail
