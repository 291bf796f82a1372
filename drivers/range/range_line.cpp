#include "drivers/range/range_line.hpp"

#include <algorithm>
#include <array>

#include "base/checked_line.hpp"
#include "base/text.hpp"

namespace bregma::range {
namespace {

using LineError = tl::unexpected<std::string_view>;

std::string_view describe(base::LineProblem problem) {
  switch (problem) {
  case base::LineProblem::kTooLong:
    return "line too long";
  case base::LineProblem::kWrongChecksum:
    return "wrong checksum";
  case base::LineProblem::kNoFrame:
    break;
  }
  return "not a message of a range sensor";
}

bool is_word(std::string_view text) {
  return !text.empty() && text.size() <= kMaxWord && std::all_of(text.begin(), text.end(), [](char c) {
    return c > ' ' && c <= '~' && c != '*' && c != '$' && c != ',';
  });
}

std::optional<Identity> identity_of(std::string_view body) {
  std::array<std::string_view, 5> fields;
  if (!base::split_fields(body, fields) || !is_word(fields[1]) || !is_word(fields[2])) {
    return std::nullopt;
  }
  const auto bits = base::parsed_number<unsigned>(fields[3]);
  const auto full_scale = base::parsed_number<unsigned>(fields[4]);
  if (!bits || *bits < 1 || *bits > 24 || !full_scale || *full_scale < 1 || *full_scale > 100'000) {
    return std::nullopt;
  }
  return Identity{std::string(fields[1]), std::string(fields[2]), *bits, *full_scale};
}

std::optional<Reading> reading_of(std::string_view body) {
  std::array<std::string_view, 4> fields;
  if (!base::split_fields(body, fields)) {
    return std::nullopt;
  }
  const auto counter = base::parsed_number<std::uint64_t>(fields[1]);
  const auto time = base::parsed_number<std::uint64_t>(fields[2]);
  if (!counter || !time || *time > kMaxTime_us) {
    return std::nullopt;
  }
  if (fields[3] == "-") {
    return Reading{*counter, *time, std::nullopt};
  }
  const auto counts = base::parsed_number<std::uint32_t>(fields[3]);
  if (!counts || *counts >= 1U << 24U) {
    return std::nullopt;
  }
  return Reading{*counter, *time, counts};
}

} // namespace

std::string line_of(const Message &message) {
  if (const auto *identity = std::get_if<Identity>(&message)) {
    return base::checked_line("I," + identity->model + "," + identity->serial + "," + std::to_string(identity->bits) +
                              "," + std::to_string(identity->full_scale_mV));
  }
  const auto &reading = std::get<Reading>(message);
  return base::checked_line("R," + std::to_string(reading.counter) + "," + std::to_string(reading.time_us) + "," +
                            (reading.counts ? std::to_string(*reading.counts) : "-"));
}

std::string identity_question() { return base::checked_line("?"); }

bool is_identity_question(std::string_view line) {
  const auto body = base::checked_body(line, kMaxLine);
  return body && *body == "?";
}

tl::expected<Message, std::string_view> parse(std::string_view line) {
  const auto body = base::checked_body(line, kMaxLine);
  if (!body) {
    return LineError(describe(body.error()));
  }
  if (body->starts_with("I,")) {
    auto identity = identity_of(*body);
    return identity ? tl::expected<Message, std::string_view>(std::move(*identity)) : LineError("not an identity");
  }
  const auto reading = body->starts_with("R,") ? reading_of(*body) : std::nullopt;
  return reading ? tl::expected<Message, std::string_view>(*reading) : LineError("not a reading");
}

} // namespace bregma::range
