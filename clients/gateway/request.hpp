// What a client of /state says: a binary message of 16 bytes, or its JSON form (docs/gateway.md). Pure functions.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

#include "clients/gateway/records.hpp"

namespace bregma::gateway {

inline constexpr std::size_t kMaxRequestBytes = 256; // of a message
inline constexpr double kMaxRate_hz = 60.0;

// Empty for everything else: another length, an unknown kind, a rate outside 1 to 60, a time that is not finite.
[[nodiscard]] std::optional<Request> parse_request(std::span<const std::byte> message);
[[nodiscard]] std::optional<Request> parse_json_request(std::string_view message);

} // namespace bregma::gateway
