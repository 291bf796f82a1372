// SHA-256 [FIPS 180-4] by OpenSSL. Pure functions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/result.hpp"

namespace bregma::casefile {

using Hash = std::array<std::uint8_t, 32>;

[[nodiscard]] Hash sha256(std::span<const std::byte> bytes);
[[nodiscard]] Hash sha256(std::string_view text);
// Of a whole file, read in parts.
[[nodiscard]] base::Result<Hash> sha256_of_file(const std::filesystem::path &file);

[[nodiscard]] std::string to_hex(const Hash &hash);
// Empty for everything but 64 hexadecimal digits.
[[nodiscard]] std::optional<Hash> from_hex(std::string_view text);

} // namespace bregma::casefile
