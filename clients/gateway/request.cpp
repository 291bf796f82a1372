#include "clients/gateway/request.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include <nlohmann/json.hpp>

namespace bregma::gateway {
namespace {

std::optional<Request> checked(const Request &request) {
  switch (static_cast<RequestKind>(request.kind)) {
  case RequestKind::kAcknowledge:
  case RequestKind::kField:
  case RequestKind::kSlices:
    return request;
  case RequestKind::kRate:
    return request.value >= 1 && request.value <= static_cast<std::uint32_t>(kMaxRate_hz) ? std::optional(request)
                                                                                          : std::nullopt;
  case RequestKind::kPing:
    return std::isfinite(request.client_ms) ? std::optional(request) : std::nullopt;
  }
  return std::nullopt;
}

} // namespace

std::optional<Request> parse_request(std::span<const std::byte> message) {
  Request request;
  if (message.size() != sizeof request) {
    return std::nullopt;
  }
  std::memcpy(&request, message.data(), sizeof request);
  return checked(request);
}

std::optional<Request> parse_json_request(std::string_view message) {
  const auto json = message.size() <= kMaxRequestBytes ? nlohmann::json::parse(message, nullptr, false)
                                                       : nlohmann::json(nlohmann::json::value_t::discarded);
  if (!json.is_object() || json.size() != 1 || !json.begin()->is_number()) {
    return std::nullopt;
  }
  const double value = json.begin()->get<double>();
  const std::string &name = json.begin().key();
  if (name == "ping") {
    return checked({static_cast<std::uint32_t>(RequestKind::kPing), 0, value});
  }
  const RequestKind kind = name == "ack"      ? RequestKind::kAcknowledge
                           : name == "rate"   ? RequestKind::kRate
                           : name == "field"  ? RequestKind::kField
                           : name == "slices" ? RequestKind::kSlices
                                              : RequestKind{};
  const bool whole = value >= 0.0 && value <= std::numeric_limits<std::uint32_t>::max() && value == std::floor(value);
  return whole ? checked({static_cast<std::uint32_t>(kind), static_cast<std::uint32_t>(value), 0.0}) : std::nullopt;
}

} // namespace bregma::gateway
