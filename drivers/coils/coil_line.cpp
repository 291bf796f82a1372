#include "drivers/coils/coil_line.hpp"

#include <array>
#include <charconv>
#include <cstdio>

#include "base/checked_line.hpp"

namespace bregma::coils {

namespace {

using Problem = tl::unexpected<std::string_view>;

std::string framed(const std::string &body) { return base::checked_line(body); }

template <class Number> bool read(std::string_view text, Number &out, int base = 10) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out, base);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

// The body between $ and *, with its checksum verified.
tl::expected<std::string_view, std::string_view> body_of(std::string_view line) {
  const auto body = base::checked_body(line, kMaxLine);
  if (body) {
    return *body;
  }
  switch (body.error()) {
  case base::LineProblem::kTooLong:
    return Problem("line too long");
  case base::LineProblem::kWrongChecksum:
    return Problem("wrong checksum");
  case base::LineProblem::kNoFrame:
    break;
  }
  return Problem("not a message of a coil controller");
}

std::string hex(std::uint64_t value) {
  char text[20];
  std::snprintf(text, sizeof text, "%llX", static_cast<unsigned long long>(value));
  return text;
}

bool is_current(std::int64_t value) { return value >= -kMaxCurrent_uA && value <= kMaxCurrent_uA; }

} // namespace

std::string line_of(const Order &order) {
  switch (order.kind) {
  case Order::Kind::kSet:
    return framed("SET," + hex(order.coils) + "," + std::to_string(order.current_uA) + "," +
                  std::to_string(order.hold_ms));
  case Order::Kind::kOff:
    return framed("OFF");
  case Order::Kind::kGet:
    break;
  }
  return framed("GET");
}

std::string line_of(const State &s) {
  return framed("STA," + std::to_string(s.counter) + "," + hex(s.coils) + "," + std::to_string(s.current_uA) + "," +
                std::to_string(s.left_ms) + "," + std::to_string(s.lowest_uA) + "," + std::to_string(s.highest_uA) +
                "," + hex(s.faults));
}

tl::expected<Order, std::string_view> parse_order(std::string_view line) {
  const auto body = body_of(line);
  if (!body) {
    return Problem(body.error());
  }
  Order out;
  if (*body == "GET") {
    return out;
  }
  if (*body == "OFF") {
    out.kind = Order::Kind::kOff;
    return out;
  }
  std::array<std::string_view, 4> fields;
  if (!base::split_fields(*body, fields) || fields[0] != "SET" || !read(fields[1], out.coils, 16) ||
      !read(fields[2], out.current_uA) || !read(fields[3], out.hold_ms)) {
    return Problem("unknown order");
  }
  if (!is_current(out.current_uA) || out.hold_ms < 0 || out.hold_ms > kMaxHold_ms) {
    return Problem("current or hold out of range");
  }
  out.kind = Order::Kind::kSet;
  return out;
}

tl::expected<State, std::string_view> parse_state(std::string_view line) {
  const auto body = body_of(line);
  if (!body) {
    return Problem(body.error());
  }
  State out;
  std::array<std::string_view, 8> fields;
  if (!base::split_fields(*body, fields) || fields[0] != "STA" || !read(fields[1], out.counter) ||
      !read(fields[2], out.coils, 16) || !read(fields[3], out.current_uA) || !read(fields[4], out.left_ms) ||
      !read(fields[5], out.lowest_uA) || !read(fields[6], out.highest_uA) || !read(fields[7], out.faults, 16)) {
    return Problem("not a state");
  }
  if (!is_current(out.current_uA) || out.left_ms < 0 || out.left_ms > kMaxHold_ms || out.lowest_uA < 0 ||
      out.highest_uA > kMaxCurrent_uA || out.lowest_uA > out.highest_uA || (out.faults & ~out.coils) != 0) {
    return Problem("a value of the state is out of range");
  }
  return out;
}

} // namespace bregma::coils
