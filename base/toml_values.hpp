// Checking and formatting of values in TOML files, shared by ParameterSet and TableReader so that they agree.
// Private to this library.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <toml++/toml.h>

#include "base/parameters.hpp"

namespace bregma::base::detail {

// The text of a file; errors name it.
// Syntax errors become "name:line: ...".
[[nodiscard]] Result<toml::table> parse_toml(std::string_view text, const std::string &name);

// The value, or the requirement ("must be between 1 and 1000 Hz").
[[nodiscard]] tl::expected<ParameterValue, std::string> convert(const toml::node &node, const ValueRule &rule);
[[nodiscard]] std::optional<std::string> violation(const ParameterValue &value, const ValueRule &rule);

// "file:line: key = value: what", or without the value.
[[nodiscard]] std::string message(const std::string &file, const toml::node &node, const std::string &key,
                                  const std::string &what, bool with_value = true);

[[nodiscard]] std::string to_toml_text(const ParameterValue &value);  // reads back to the same value
[[nodiscard]] std::string to_plain_text(const ParameterValue &value); // for output: "30", not "30.0"
[[nodiscard]] std::string range_text(const ValueRule &rule);          // "1 to 1000 Hz"; "" without a range

// "; did you mean x?" for the candidate nearest to key, or "" when none is near.
[[nodiscard]] std::string suggestion(std::string_view key, const std::vector<std::string> &candidates);

} // namespace bregma::base::detail
