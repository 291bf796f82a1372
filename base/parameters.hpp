// A program's parameters. Each is declared once, with key, storage, type, unit, range and text; the stored value at
// declaration is the default. Reading, checking, the commented file and the table in the documentation all use that
// declaration.
//
//   ParameterSet set("bregmad");
//   set.number("navigation.floor_rate_hz", &config.floor_rate_hz, "Hz", 1, 1000, "Minimum rate of the state");
//   if (auto ok = set.load(path); !ok) ... ok.error().message
//
// Errors read "file:line: key = value: must be between 1 and 1000 Hz". Nothing is changed when a load fails.
// Threads: one at a time; the pointers must outlive the set. Declaring a key twice, or with a default that it would
// refuse itself, is a programming error and throws std::logic_error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/result.hpp"

namespace bregma::base {

using ParameterValue = std::variant<double, std::int64_t, bool, std::string>;

// Requirements on a value. min and max hold a number or an integer, and are empty strings where it has no range; other
// types have no range.
struct ValueRule {
  enum class Type { kNumber, kInteger, kFlag, kString, kChoice };
  Type type = Type::kString;
  std::string unit; // "" for a pure number
  ParameterValue min = std::string();
  ParameterValue max = std::string();
  std::vector<std::string> choices;
};

class ParameterSet {
public:
  explicit ParameterSet(std::string program) : program_(std::move(program)) {}

  // Keys are dotted: "section.name". Ranges include their ends.
  ParameterSet &number(std::string key, double *value, std::string unit, double min, double max, std::string text);
  ParameterSet &integer(std::string key, std::int64_t *value, std::string unit, std::int64_t min, std::int64_t max,
                        std::string text);
  ParameterSet &flag(std::string key, bool *value, std::string text);
  ParameterSet &string(std::string key, std::string *value, std::string text);
  // One of the names.
  ParameterSet &choice(std::string key, std::string *value, std::vector<std::string> choices, std::string text);
  // The value that belongs to the name.
  template <class Enum>
  ParameterSet &choice(std::string key, Enum *value, std::initializer_list<std::pair<const char *, Enum>> choices,
                       std::string text) {
    const std::vector<std::pair<std::string, Enum>> table(choices.begin(), choices.end());
    std::vector<std::string> names;
    names.reserve(table.size());
    for (const auto &entry : table) {
      names.push_back(entry.first);
    }
    const auto get = [value, table]() -> ParameterValue {
      for (const auto &[name, chosen] : table) {
        if (chosen == *value) {
          return name;
        }
      }
      return std::string();
    };
    const auto set = [value, table](const ParameterValue &chosen) {
      for (const auto &[name, entry] : table) {
        *value = name == std::get<std::string>(chosen) ? entry : *value;
      }
    };
    return declare(
        {std::move(key), {ValueRule::Type::kChoice, {}, {}, {}, std::move(names)}, std::move(text), get, set, get()});
  }

  // Values that the file does not contain are unchanged. Unknown keys are errors that name the nearest known one.
  [[nodiscard]] Result<void> load(const std::filesystem::path &file);
  [[nodiscard]] Result<void> load_text(std::string_view toml, const std::string &name);
  // "key=value" from a command line, where a string needs no quotes.
  [[nodiscard]] Result<void> set_from_string(std::string_view assignment);

  // A complete commented file of the present values; load() restores them bit for bit.
  [[nodiscard]] std::string to_toml() const;
  // The parameters as a Markdown table, with their defaults.
  [[nodiscard]] std::string to_markdown() const;

private:
  struct Parameter {
    std::string key;
    ValueRule rule;
    std::string text;
    std::function<ParameterValue()> get;
    std::function<void(const ParameterValue &)> set;
    ParameterValue standard;
  };
  ParameterSet &declare(Parameter parameter);
  [[nodiscard]] const Parameter *find(std::string_view key) const;
  [[nodiscard]] std::vector<std::string> keys() const;
  [[nodiscard]] bool section_is_known(const std::string &section) const;

  std::string program_;
  std::vector<Parameter> parameters_; // sections together, in the order of their first key
};

} // namespace bregma::base
