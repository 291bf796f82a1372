#include "base/toml_values.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numeric>
#include <sstream>

namespace bregma::base::detail {

namespace {

using Type = ValueRule::Type;
constexpr std::size_t kShownLength = 60; // maximal length of a value in a message

bool has_range(const ValueRule &rule) {
  const bool ordered = rule.type == Type::kNumber || rule.type == Type::kInteger;
  return ordered && !std::holds_alternative<std::string>(rule.min);
}

std::string with_unit(const std::string &text, const std::string &unit) {
  return unit.empty() ? text : text + " " + unit;
}

std::string quoted_list(const std::vector<std::string> &names) {
  std::string out;
  for (const std::string &name : names) {
    out += (out.empty() ? "\"" : ", \"") + name + "\"";
  }
  return out;
}

std::string type_text(const ValueRule &rule) {
  switch (rule.type) {
  case Type::kNumber:
    return rule.unit.empty() ? "must be a number" : "must be a number, in " + rule.unit;
  case Type::kInteger:
    return rule.unit.empty() ? "must be a whole number" : "must be a whole number, in " + rule.unit;
  case Type::kFlag:
    return "must be true or false";
  case Type::kChoice:
    return "must be one of " + quoted_list(rule.choices);
  case Type::kString:
    break;
  }
  return "must be a text in quotes";
}

std::string number_text(double value) {
  std::array<char, 32> buffer{};
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return {buffer.data(), end.ptr};
}

// Format: double quotes, one line.
template <class Node> std::string formatted(const Node &node) {
  using toml::format_flags;
  constexpr format_flags kFlags = toml::toml_formatter::default_flags &
                                  ~(format_flags::allow_literal_strings | format_flags::allow_multi_line_strings);
  std::ostringstream out;
  out << toml::toml_formatter(node, kFlags);
  return out.str();
}

std::string shown(const toml::node &node) {
  std::string text;
  for (const char c : node.visit([](const auto &value) { return formatted(value); })) {
    const bool blank = c == '\n' || c == ' ';
    if (!blank || text.empty() || text.back() != ' ') {
      text += blank ? ' ' : c;
    }
  }
  return text.size() <= kShownLength ? text : text.substr(0, kShownLength) + "...";
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

} // namespace

Result<toml::table> parse_toml(std::string_view text, const std::string &name) {
  try {
    return toml::parse(text, std::string_view(name));
  } catch (const toml::parse_error &error) {
    return failure(name + ":" + std::to_string(error.source().begin.line) + ": " + std::string(error.description()));
  }
}

std::optional<std::string> violation(const ParameterValue &value, const ValueRule &rule) {
  if (const double *number = std::get_if<double>(&value); number != nullptr && !std::isfinite(*number)) {
    return "must be a finite number";
  }
  if (rule.type == Type::kChoice &&
      std::find(rule.choices.begin(), rule.choices.end(), std::get<std::string>(value)) == rule.choices.end()) {
    return type_text(rule);
  }
  if (has_range(rule) && (value < rule.min || rule.max < value)) {
    return "must be between " + to_plain_text(rule.min) + " and " + with_unit(to_plain_text(rule.max), rule.unit);
  }
  return std::nullopt;
}

tl::expected<ParameterValue, std::string> convert(const toml::node &node, const ValueRule &rule) {
  std::optional<ParameterValue> value;
  switch (rule.type) {
  case Type::kNumber:
    if (node.is_number()) {
      value = *node.value<double>();
    }
    break;
  case Type::kInteger:
    if (node.is_integer()) {
      value = *node.value<std::int64_t>();
    }
    break;
  case Type::kFlag:
    if (node.is_boolean()) {
      value = *node.value<bool>();
    }
    break;
  case Type::kString:
  case Type::kChoice:
    if (node.is_string()) {
      value = *node.value<std::string>();
    }
    break;
  }
  if (!value) {
    return tl::unexpected(type_text(rule));
  }
  if (auto wrong = violation(*value, rule)) {
    return tl::unexpected(*wrong);
  }
  return *value;
}

std::string message(const std::string &file, const toml::node &node, const std::string &key, const std::string &what,
                    bool with_value) {
  const auto line = node.source().begin.line;
  const std::string place = line == 0 ? file : file + ":" + std::to_string(line);
  return place + ": " + key + (with_value ? " = " + shown(node) : "") + ": " + what;
}

std::string to_toml_text(const ParameterValue &value) {
  if (const double *number = std::get_if<double>(&value)) {
    const std::string text = number_text(*number);
    return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
  }
  if (const std::string *text = std::get_if<std::string>(&value)) {
    return formatted(toml::value<std::string>(*text)); // toml++ knows which characters to escape
  }
  return to_plain_text(value);
}

std::string to_plain_text(const ParameterValue &value) {
  if (const double *number = std::get_if<double>(&value)) {
    return number_text(*number);
  }
  if (const auto *integer = std::get_if<std::int64_t>(&value)) {
    return std::to_string(*integer);
  }
  if (const bool *flag = std::get_if<bool>(&value)) {
    return *flag ? "true" : "false";
  }
  return std::get<std::string>(value);
}

std::string range_text(const ValueRule &rule) {
  if (rule.type == Type::kChoice) {
    return "one of " + quoted_list(rule.choices);
  }
  if (rule.type == Type::kFlag) {
    return "true or false";
  }
  return has_range(rule) ? with_unit(to_plain_text(rule.min) + " to " + to_plain_text(rule.max), rule.unit) : rule.unit;
}

std::string suggestion(std::string_view key, const std::vector<std::string> &candidates) {
  const std::string *best = nullptr;
  std::size_t best_distance = std::max<std::size_t>(3, key.size() / 3) + 1;
  for (const std::string &candidate : candidates) {
    const std::size_t distance = edit_distance(key, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = &candidate;
    }
  }
  return best == nullptr ? "" : "; did you mean " + *best + "?";
}

} // namespace bregma::base::detail
