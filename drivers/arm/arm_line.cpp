#include "drivers/arm/arm_line.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <type_traits>
#include <utility>

#include "base/checked_line.hpp"
#include "base/text.hpp"

namespace bregma::arm {
namespace {

constexpr std::array<std::string_view, 4> kStates{"DISABLED", "ENABLED", "PAUSED", "FAULT"};
constexpr std::array<std::string_view, 7> kReasons{"none", "stop",  "emergency", "watchdog",
                                                   "link", "limit", "following"};
constexpr std::array<std::string_view, 6> kOrders{"enable", "disable", "hold", "stop", "reset", "identity"};

bool is_text_char(char c) { return c >= ' ' && c <= '~' && c != ',' && c != '*' && c != '$'; }

bool is_text(std::string_view text) {
  return text.size() <= kMaxText && std::all_of(text.begin(), text.end(), is_text_char);
}

// Reads the fields of a body one after another; after a problem every further value is worthless and ok() false.
class Fields {
public:
  explicit Fields(std::string_view body) : rest_(body) {}

  std::string_view next() {
    if (done_) {
      ok_ = false;
      return {};
    }
    const std::size_t comma = rest_.find(',');
    const std::string_view field = rest_.substr(0, comma);
    done_ = comma == std::string_view::npos;
    rest_ = done_ ? std::string_view() : rest_.substr(comma + 1);
    return field;
  }
  template <class Number> void read(Number &out) {
    const auto value = base::parsed_number<Number>(next());
    ok_ = ok_ && value.has_value();
    out = value.value_or(Number{});
    if constexpr (std::is_same_v<Number, double>) {
      ok_ = ok_ && std::isfinite(out);
    }
  }
  template <std::size_t N> void read(std::array<double, N> &out) {
    for (double &value : out) {
      read(value);
    }
  }
  void read(bool &out) {
    const std::string_view field = next();
    ok_ = ok_ && (field == "0" || field == "1");
    out = field == "1";
  }
  void read(std::string &out) {
    const std::string_view field = next();
    ok_ = ok_ && is_text(field);
    out = field;
  }
  void read(LinePose &out) {
    read(out.translation_mm);
    read(out.rotation_wxyz);
    double squares = 0.0;
    for (const double q : out.rotation_wxyz) {
      squares += q * q;
    }
    ok_ = ok_ && std::abs(std::sqrt(squares) - 1.0) <= 1e-3;
  }
  template <class Word, std::size_t N> void read(Word &out, const std::array<std::string_view, N> &words) {
    const auto found = std::find(words.begin(), words.end(), next());
    ok_ = ok_ && found != words.end();
    out = static_cast<Word>(found == words.end() ? 0 : found - words.begin());
  }
  void require(bool condition) { ok_ = ok_ && condition; }
  // Everything was read, and nothing is left.
  [[nodiscard]] bool ok() const { return ok_ && done_; }

private:
  std::string_view rest_;
  bool done_ = false;
  bool ok_ = true;
};

void put(std::string &out, double value) {
  std::array<char, 40> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  out.append(",").append(text.data(), end);
}
void put(std::string &out, std::uint64_t value) { out += "," + std::to_string(value); }
void put(std::string &out, bool value) { out += value ? ",1" : ",0"; }
void put(std::string &out, std::string_view text) { out.append(",").append(text); }
template <std::size_t N> void put(std::string &out, const std::array<double, N> &values) {
  for (const double value : values) {
    put(out, value);
  }
}
void put(std::string &out, const LinePose &pose) {
  put(out, pose.translation_mm);
  put(out, pose.rotation_wxyz);
}
template <class Message> void put_stamp(std::string &out, const Message &message) {
  put(out, message.frame);
  put(out, message.time_us);
}
template <class Message> void read_stamp(Fields &fields, Message &message) {
  fields.read(message.frame);
  fields.read(message.time_us);
  fields.require(message.time_us <= kMaxTime_us);
}

std::string body_of(const Identity &m) {
  std::string out = "identity";
  put(out, std::string_view(m.name));
  put(out, std::string_view(m.serial));
  put(out, m.simulated);
  return out;
}
std::string body_of(const OperatingState &m) {
  std::string out = "operating_state";
  put_stamp(out, m);
  put(out, kStates[static_cast<std::size_t>(m.state)]);
  put(out, m.is_homed);
  put(out, m.is_busy);
  put(out, std::uint64_t{m.motion});
  put(out, std::uint64_t{m.waypoint});
  put(out, m.stop_mm);
  put(out, kReasons[static_cast<std::size_t>(m.reason)]);
  return out;
}
std::string body_of(const MeasuredJs &m) {
  std::string out = "measured_js";
  put_stamp(out, m);
  put(out, m.position_rad);
  put(out, m.velocity_rad_s);
  put(out, m.effort_Nm);
  return out;
}
std::string body_of(const MeasuredCp &m) {
  std::string out = "measured_cp";
  put_stamp(out, m);
  put(out, m.T_base_flange);
  return out;
}
std::string body_of(const SetpointJs &m) {
  std::string out = "setpoint_js";
  put_stamp(out, m);
  put(out, m.position_rad);
  return out;
}
std::string body_of(const Answer &m) {
  std::string out = "answer";
  put(out, std::uint64_t{m.number});
  put(out, m.ok);
  put(out, std::string_view(m.text));
  return out;
}
std::string body_of(const Order &m) {
  std::string out(kOrders[static_cast<std::size_t>(m.kind)]);
  put(out, std::uint64_t{m.number});
  return out;
}
std::string body_of(const MoveCp &m) {
  std::string out = "move_cp";
  put(out, std::uint64_t{m.number});
  put(out, std::uint64_t{m.motion});
  put(out, std::uint64_t{m.index});
  put(out, std::uint64_t{m.count});
  put(out, m.speed_mm_s);
  put(out, m.T_base_flange);
  return out;
}
std::string body_of(const Alive &m) {
  std::string out = "alive";
  put(out, std::uint64_t{m.motion});
  return out;
}

void read_fields(Fields &fields, Identity &m) {
  fields.read(m.name);
  fields.read(m.serial);
  fields.read(m.simulated);
}
void read_fields(Fields &fields, OperatingState &m) {
  read_stamp(fields, m);
  fields.read(m.state, kStates);
  fields.read(m.is_homed);
  fields.read(m.is_busy);
  fields.read(m.motion);
  fields.read(m.waypoint);
  fields.read(m.stop_mm);
  fields.read(m.reason, kReasons);
  fields.require(m.waypoint <= kMaxWaypoints && m.stop_mm >= 0.0);
}
void read_fields(Fields &fields, MeasuredJs &m) {
  read_stamp(fields, m);
  fields.read(m.position_rad);
  fields.read(m.velocity_rad_s);
  fields.read(m.effort_Nm);
}
void read_fields(Fields &fields, MeasuredCp &m) {
  read_stamp(fields, m);
  fields.read(m.T_base_flange);
}
void read_fields(Fields &fields, SetpointJs &m) {
  read_stamp(fields, m);
  fields.read(m.position_rad);
}
void read_fields(Fields &fields, Answer &m) {
  fields.read(m.number);
  fields.read(m.ok);
  fields.read(m.text);
}
void read_fields(Fields &fields, MoveCp &m) {
  fields.read(m.number);
  fields.read(m.motion);
  fields.read(m.index);
  fields.read(m.count);
  fields.read(m.speed_mm_s);
  fields.read(m.T_base_flange);
  fields.require(m.motion > 0 && m.count <= kMaxWaypoints && m.index < m.count && m.speed_mm_s > 0.0);
}
void read_fields(Fields &fields, Alive &m) { fields.read(m.motion); }

tl::expected<std::string_view, std::string_view> body_in(std::string_view line) {
  const auto body = base::checked_body(line, kMaxLine);
  if (body) {
    return *body;
  }
  switch (body.error()) {
  case base::LineProblem::kTooLong:
    return tl::unexpected(std::string_view("line too long"));
  case base::LineProblem::kWrongChecksum:
    return tl::unexpected(std::string_view("wrong checksum"));
  case base::LineProblem::kNoFrame:
    break;
  }
  return tl::unexpected(std::string_view("not a message of an arm"));
}

template <class Variant, class Message>
tl::expected<Variant, std::string_view> message_of(Fields &fields, Message out) {
  read_fields(fields, out);
  if (!fields.ok()) {
    return tl::unexpected(std::string_view("a field is missing or out of range"));
  }
  return Variant(std::move(out));
}

} // namespace

std::string line_of(const FromArm &message) {
  return base::checked_line(std::visit([](const auto &m) { return body_of(m); }, message));
}

std::string line_of(const ToArm &message) {
  return base::checked_line(std::visit([](const auto &m) { return body_of(m); }, message));
}

tl::expected<FromArm, std::string_view> parse_from_arm(std::string_view line) {
  const auto body = body_in(line);
  if (!body) {
    return tl::unexpected(body.error());
  }
  Fields fields(*body);
  const std::string_view name = fields.next();
  if (name == "identity") {
    return message_of<FromArm>(fields, Identity());
  }
  if (name == "operating_state") {
    return message_of<FromArm>(fields, OperatingState());
  }
  if (name == "measured_js") {
    return message_of<FromArm>(fields, MeasuredJs());
  }
  if (name == "measured_cp") {
    return message_of<FromArm>(fields, MeasuredCp());
  }
  if (name == "setpoint_js") {
    return message_of<FromArm>(fields, SetpointJs());
  }
  if (name == "answer") {
    return message_of<FromArm>(fields, Answer());
  }
  return tl::unexpected(std::string_view("unknown message"));
}

tl::expected<ToArm, std::string_view> parse_to_arm(std::string_view line) {
  const auto body = body_in(line);
  if (!body) {
    return tl::unexpected(body.error());
  }
  Fields fields(*body);
  const std::string_view name = fields.next();
  if (name == "move_cp") {
    return message_of<ToArm>(fields, MoveCp());
  }
  if (name == "alive") {
    return message_of<ToArm>(fields, Alive());
  }
  const auto found = std::find(kOrders.begin(), kOrders.end(), name);
  if (found == kOrders.end()) {
    return tl::unexpected(std::string_view("unknown message"));
  }
  Order order{static_cast<Order::Kind>(found - kOrders.begin()), 0};
  fields.read(order.number);
  if (!fields.ok()) {
    return tl::unexpected(std::string_view("a field is missing or out of range"));
  }
  return ToArm(order);
}

std::string line_text(std::string_view text) {
  std::string out(text.substr(0, kMaxText));
  std::replace_if(
      out.begin(), out.end(), [](char c) { return !is_text_char(c); }, ' ');
  return out;
}

} // namespace bregma::arm
