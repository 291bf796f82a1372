#include "base/table_reader.hpp"

#include <algorithm>
#include <cmath>

#include "base/read_file.hpp"
#include "base/toml_values.hpp"

namespace bregma::base {

namespace {

using Type = ValueRule::Type;

ValueRule number_rule(std::string_view unit, double min, double max) {
  return {Type::kNumber, std::string(unit), min, max, {}};
}

ValueRule integer_rule(std::string_view unit, std::int64_t min, std::int64_t max) {
  return {Type::kInteger, std::string(unit), min, max, {}};
}

const ValueRule kStringRule{Type::kString, {}, {}, {}, {}};
const ValueRule kFlagRule{Type::kFlag, {}, {}, {}, {}};

std::string rule_text(const ValueRule &rule) { return rule.type == Type::kString ? "text" : detail::range_text(rule); }

std::string vector_text(const Eigen::Vector3d &vector) {
  const Eigen::Vector3d v = vector + Eigen::Vector3d::Zero(); // -0.0 is 0.0
  return "[" + detail::to_toml_text(v.x()) + ", " + detail::to_toml_text(v.y()) + ", " + detail::to_toml_text(v.z()) +
         "]";
}

// "tools[2].name" is "tools[].name" in the layout.
std::string without_indexes(const std::string &key) {
  std::string out;
  bool inside = false;
  for (const char c : key) {
    inside = inside && c != ']';
    if (!inside) {
      out += c;
    }
    inside = inside || c == '[';
  }
  return out;
}

template <class T> T value_or(const std::optional<ParameterValue> &value, T fallback) {
  return value ? std::get<T>(*value) : std::move(fallback);
}

} // namespace

TableReader::TableReader(const toml::table &table, std::shared_ptr<Sink> sink, std::string path)
    : table_(&table), sink_(std::move(sink)), path_(std::move(path)) {}

std::string TableReader::full(std::string_view key) const {
  return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
}

bool TableReader::has(std::string_view key) const { return table_->contains(key); }

const toml::node *TableReader::find(std::string_view key) {
  asked_.emplace(key);
  return table_->get(key);
}

const toml::node *TableReader::require(std::string_view key) {
  const toml::node *node = find(key);
  if (node == nullptr) {
    report(*table_, full(key), "is missing", false);
  }
  return node;
}

void TableReader::report(const toml::node &where, const std::string &key, const std::string &what, bool with_value) {
  if (!sink_->first_error) {
    sink_->first_error = Error{detail::message(sink_->file, where, key, what, with_value)};
  }
}

void TableReader::refuse(std::string_view key, const std::string &what) {
  const toml::node *node = toml::at_path(*table_, key).node();
  const bool scalar = node != nullptr && !node->is_table() && !node->is_array_of_tables();
  report(node == nullptr ? *table_ : *node, full(key), what, scalar);
}

void TableReader::note(std::string_view key, bool required, std::string rule, std::string fallback) {
  KnownKey fresh{without_indexes(full(key)), required, std::move(rule), std::move(fallback)};
  const bool seen = std::any_of(sink_->known.begin(), sink_->known.end(),
                                [&fresh](const KnownKey &known) { return known.key == fresh.key; });
  if (!seen) {
    sink_->known.push_back(std::move(fresh));
  }
}

std::optional<ParameterValue> TableReader::value(std::string_view key, const ValueRule &rule, bool required,
                                                 const std::optional<ParameterValue> &fallback) {
  note(key, required, rule_text(rule), fallback ? detail::to_toml_text(*fallback) : std::string());
  const toml::node *node = required ? require(key) : find(key);
  if (node == nullptr) {
    return std::nullopt;
  }
  auto value = detail::convert(*node, rule);
  if (!value) {
    report(*node, full(key), value.error(), true);
    return std::nullopt;
  }
  return *value;
}

std::string TableReader::require_string(std::string_view key) {
  return value_or<std::string>(value(key, kStringRule, true), "");
}

double TableReader::require_number(std::string_view key, std::string_view unit, double min, double max) {
  return value_or(value(key, number_rule(unit, min, max), true), min);
}

std::int64_t TableReader::require_integer(std::string_view key, std::string_view unit, std::int64_t min,
                                          std::int64_t max) {
  return value_or(value(key, integer_rule(unit, min, max), true), min);
}

std::string TableReader::require_choice(std::string_view key, const std::vector<std::string> &choices) {
  return value_or<std::string>(value(key, {Type::kChoice, {}, {}, {}, choices}, true), "");
}

std::string TableReader::string(std::string_view key, std::string fallback) {
  return value_or(value(key, kStringRule, false, fallback), fallback);
}

double TableReader::number(std::string_view key, double fallback, std::string_view unit, double min, double max) {
  return value_or(value(key, number_rule(unit, min, max), false, fallback), fallback);
}

std::optional<double> TableReader::optional_number(std::string_view key, std::string_view unit, double min,
                                                   double max) {
  const auto read = value(key, number_rule(unit, min, max), false);
  return read ? std::optional(std::get<double>(*read)) : std::nullopt;
}

std::int64_t TableReader::integer(std::string_view key, std::int64_t fallback, std::string_view unit, std::int64_t min,
                                  std::int64_t max) {
  return value_or(value(key, integer_rule(unit, min, max), false, fallback), fallback);
}

bool TableReader::flag(std::string_view key, bool fallback) {
  return value_or(value(key, kFlagRule, false, fallback), fallback);
}

std::string TableReader::choice(std::string_view key, std::string fallback, const std::vector<std::string> &choices) {
  return value_or(value(key, {Type::kChoice, {}, {}, {}, choices}, false, fallback), fallback);
}

std::optional<Eigen::Vector3d> TableReader::vector_of(const toml::node &node, const std::string &key) {
  const toml::array *array = node.as_array();
  Eigen::Vector3d out;
  bool good = array != nullptr && array->size() == 3;
  for (std::size_t i = 0; good && i < 3; ++i) {
    const auto coordinate = (*array)[i].is_number() ? (*array)[i].value<double>() : std::nullopt;
    good = coordinate && std::isfinite(*coordinate);
    out[static_cast<Eigen::Index>(i)] = coordinate.value_or(0.0);
  }
  if (!good) {
    report(node, key, "must be three finite numbers, [x, y, z]", true);
    return std::nullopt;
  }
  return out;
}

Eigen::Vector3d TableReader::require_vector3(std::string_view key) {
  note(key, true, "[x, y, z]");
  const toml::node *node = require(key);
  return node == nullptr ? Eigen::Vector3d::Zero() : vector_of(*node, full(key)).value_or(Eigen::Vector3d::Zero());
}

Eigen::Vector3d TableReader::vector3(std::string_view key, const Eigen::Vector3d &fallback) {
  note(key, false, "[x, y, z]", vector_text(fallback));
  const toml::node *node = find(key);
  return node == nullptr ? fallback : vector_of(*node, full(key)).value_or(fallback);
}

std::optional<Eigen::Vector3d> TableReader::optional_vector3(std::string_view key) {
  note(key, false, "[x, y, z]");
  const toml::node *node = find(key);
  return node == nullptr ? std::nullopt : vector_of(*node, full(key));
}

std::vector<Eigen::Vector3d> TableReader::require_vector3s(std::string_view key) {
  note(key, true, "list of [x, y, z]");
  return require(key) == nullptr ? std::vector<Eigen::Vector3d>() : vector3s(key);
}

std::vector<double> TableReader::require_numbers(std::string_view key, std::size_t count) {
  const std::string rule = "list of " + std::to_string(count) + " numbers";
  note(key, true, rule);
  std::vector<double> out;
  const toml::node *node = require(key);
  if (node != nullptr && node->is_array() && node->as_array()->size() == count) {
    for (const toml::node &item : *node->as_array()) {
      const auto value = item.value<double>();
      if (!value || !std::isfinite(*value)) {
        break;
      }
      out.push_back(*value);
    }
  }
  if (node != nullptr && out.size() != count) {
    report(*node, full(key), "must be a " + rule, false);
  }
  out.resize(count, 0.0);
  return out;
}

std::vector<Eigen::Vector3d> TableReader::vector3s(std::string_view key) {
  note(key, false, "list of [x, y, z]");
  std::vector<Eigen::Vector3d> out;
  const toml::node *node = find(key);
  if (node == nullptr) {
    return out;
  }
  if (!node->is_array()) {
    report(*node, full(key), "must be a list of [x, y, z]", true);
    return out;
  }
  for (const toml::node &item : *node->as_array()) {
    if (auto v = vector_of(item, full(key) + "[" + std::to_string(out.size()) + "]")) {
      out.push_back(*v);
    } else {
      break;
    }
  }
  return out;
}

std::vector<std::string> TableReader::strings(std::string_view key) {
  note(key, false, "list of texts");
  std::vector<std::string> out;
  const toml::node *node = find(key);
  if (node == nullptr) {
    return out;
  }
  if (!node->is_array()) {
    report(*node, full(key), "must be a list of texts in quotes", true);
    return out;
  }
  for (const toml::node &item : *node->as_array()) {
    if (!item.is_string()) {
      report(item, full(key) + "[" + std::to_string(out.size()) + "]", "must be a text in quotes", true);
      break;
    }
    out.push_back(*item.value<std::string>());
  }
  return out;
}

std::vector<TableReader> TableReader::tables(std::string_view key) {
  std::vector<TableReader> out;
  const toml::node *node = find(key);
  if (node == nullptr) {
    return out;
  }
  const toml::array *array = node->as_array();
  const bool good = array != nullptr && (array->empty() || node->is_array_of_tables());
  if (!good) {
    report(*node, full(key), "must be a list of tables, [[" + full(key) + "]]", !node->is_table());
    return out;
  }
  for (const toml::node &item : *array) {
    out.emplace_back(*item.as_table(), sink_, full(key) + "[" + std::to_string(out.size()) + "]");
  }
  return out;
}

std::optional<TableReader> TableReader::table(std::string_view key) {
  const toml::node *node = find(key);
  if (node == nullptr) {
    return std::nullopt;
  }
  if (!node->is_table()) {
    report(*node, full(key), "must be a section, [" + full(key) + "]", !node->is_array_of_tables());
    return std::nullopt;
  }
  return TableReader(*node->as_table(), sink_, full(key));
}

Result<void> TableReader::finish() {
  std::vector<std::string> known;
  for (const std::string &key : asked_) {
    known.push_back(full(key));
  }
  const toml::node *first_unknown = nullptr;
  std::string unknown_key;
  for (const auto &[key, node] : *table_) {
    const bool earlier = first_unknown == nullptr || node.source().begin.line < first_unknown->source().begin.line;
    if (!asked_.contains(key.str()) && earlier) {
      first_unknown = &node;
      unknown_key = full(key.str());
    }
  }
  if (first_unknown != nullptr) {
    const bool scalar = !first_unknown->is_table() && !first_unknown->is_array_of_tables();
    report(*first_unknown, unknown_key, "unknown key" + detail::suggestion(unknown_key, known), scalar);
  }
  if (sink_->first_error) {
    return tl::unexpected(*sink_->first_error);
  }
  return {};
}

Result<TomlDocument> TomlDocument::read(const std::filesystem::path &file) {
  const auto text = read_file(file);
  if (!text) {
    return tl::unexpected(text.error());
  }
  return parse(*text, file.string());
}

Result<TomlDocument> TomlDocument::parse(std::string_view text, const std::string &name) {
  auto table = detail::parse_toml(text, name);
  if (!table) {
    return tl::unexpected(table.error());
  }
  TomlDocument out;
  out.table_ = std::make_shared<const toml::table>(std::move(*table));
  out.sink_ = std::make_shared<TableReader::Sink>(TableReader::Sink{name, std::nullopt, {}});
  return out;
}

TableReader TomlDocument::root() const { return {*table_, sink_}; }

} // namespace bregma::base
