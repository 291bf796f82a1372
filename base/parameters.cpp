#include "base/parameters.hpp"

#include <algorithm>
#include <stdexcept>

#include "base/read_file.hpp"
#include "base/text.hpp"
#include "base/toml_values.hpp"

namespace bregma::base {

namespace {

std::string section_of(const std::string &key) {
  const std::size_t dot = key.rfind('.');
  return dot == std::string::npos ? "" : key.substr(0, dot);
}

std::string name_of(const std::string &key) {
  const std::size_t dot = key.rfind('.');
  return dot == std::string::npos ? key : key.substr(dot + 1);
}

// Completes a text to a sentence.
std::string sentence(const std::string &text) { return text.empty() || text.back() == '.' ? text : text + "."; }

struct Leaf {
  std::string key;
  const toml::node *node;
};

void collect_leaves(const toml::table &table, const std::string &prefix, std::vector<Leaf> &out) {
  for (const auto &[key, node] : table) {
    const std::string full = prefix.empty() ? std::string(key.str()) : prefix + "." + std::string(key.str());
    if (const toml::table *inner = node.as_table(); inner != nullptr && !inner->empty()) {
      collect_leaves(*inner, full, out);
    } else {
      out.push_back({full, &node});
    }
  }
}

template <class T> auto getter(T *value) {
  return [value]() -> ParameterValue { return *value; };
}

template <class T> auto setter(T *value) {
  return [value](const ParameterValue &given) { *value = std::get<T>(given); };
}

} // namespace

ParameterSet &ParameterSet::declare(Parameter parameter) {
  if (auto wrong = detail::violation(parameter.standard, parameter.rule)) {
    throw std::logic_error(program_ + ": default of " + parameter.key + " = " +
                           detail::to_plain_text(parameter.standard) + " " + *wrong);
  }
  const std::string section = section_of(parameter.key);
  auto end_of_section = parameters_.end();
  for (auto it = parameters_.begin(); it != parameters_.end(); ++it) {
    if (it->key == parameter.key) {
      throw std::logic_error(program_ + ": parameter " + parameter.key + " is declared twice");
    }
    if (section_of(it->key) == section) {
      end_of_section = std::next(it);
    }
  }
  // TOML cannot return to the root table, so keys without a section come first.
  if (section.empty() && end_of_section == parameters_.end()) {
    end_of_section = std::find_if(parameters_.begin(), parameters_.end(),
                                  [](const Parameter &p) { return !section_of(p.key).empty(); });
  }
  parameters_.insert(end_of_section, std::move(parameter));
  return *this;
}

ParameterSet &ParameterSet::number(std::string key, double *value, std::string unit, double min, double max,
                                   std::string text) {
  return declare({std::move(key),
                  {ValueRule::Type::kNumber, std::move(unit), min, max, {}},
                  std::move(text),
                  getter(value),
                  setter(value),
                  *value});
}

ParameterSet &ParameterSet::integer(std::string key, std::int64_t *value, std::string unit, std::int64_t min,
                                    std::int64_t max, std::string text) {
  return declare({std::move(key),
                  {ValueRule::Type::kInteger, std::move(unit), min, max, {}},
                  std::move(text),
                  getter(value),
                  setter(value),
                  *value});
}

ParameterSet &ParameterSet::flag(std::string key, bool *value, std::string text) {
  return declare({std::move(key),
                  {ValueRule::Type::kFlag, {}, {}, {}, {}},
                  std::move(text),
                  getter(value),
                  setter(value),
                  *value});
}

ParameterSet &ParameterSet::string(std::string key, std::string *value, std::string text) {
  return declare({std::move(key),
                  {ValueRule::Type::kString, {}, {}, {}, {}},
                  std::move(text),
                  getter(value),
                  setter(value),
                  *value});
}

ParameterSet &ParameterSet::choice(std::string key, std::string *value, std::vector<std::string> choices,
                                   std::string text) {
  return declare({std::move(key),
                  {ValueRule::Type::kChoice, {}, {}, {}, std::move(choices)},
                  std::move(text),
                  getter(value),
                  setter(value),
                  *value});
}

std::vector<std::string> ParameterSet::keys() const {
  std::vector<std::string> out;
  out.reserve(parameters_.size());
  for (const Parameter &p : parameters_) {
    out.push_back(p.key);
  }
  return out;
}

const ParameterSet::Parameter *ParameterSet::find(std::string_view key) const {
  const auto it =
      std::find_if(parameters_.begin(), parameters_.end(), [key](const Parameter &p) { return p.key == key; });
  return it == parameters_.end() ? nullptr : &*it;
}

Result<void> ParameterSet::load(const std::filesystem::path &file) {
  const auto text = read_file(file);
  if (!text) {
    return tl::unexpected(text.error());
  }
  return load_text(*text, file.string());
}

Result<void> ParameterSet::load_text(std::string_view toml, const std::string &name) {
  const auto table = detail::parse_toml(toml, name);
  if (!table) {
    return tl::unexpected(table.error());
  }
  std::vector<Leaf> leaves;
  collect_leaves(*table, "", leaves);
  // toml++ sorts keys, but errors are reported in the order of the file.
  std::stable_sort(leaves.begin(), leaves.end(), [](const Leaf &a, const Leaf &b) {
    return a.node->source().begin.line < b.node->source().begin.line;
  });

  std::vector<std::pair<const Parameter *, ParameterValue>> read;
  for (const Leaf &leaf : leaves) {
    const Parameter *parameter = find(leaf.key);
    if (parameter == nullptr) {
      const bool section = leaf.node->is_table();
      if (section && !section_is_known(leaf.key)) {
        return failure(detail::message(name, *leaf.node, leaf.key, "unknown section", false));
      }
      if (section) {
        continue;
      }
      return failure(detail::message(name, *leaf.node, leaf.key, "unknown key" + detail::suggestion(leaf.key, keys())));
    }
    auto value = detail::convert(*leaf.node, parameter->rule);
    if (!value) {
      return failure(detail::message(name, *leaf.node, leaf.key, value.error()));
    }
    read.emplace_back(parameter, std::move(*value));
  }
  for (const auto &[parameter, value] : read) {
    parameter->set(value);
  }
  return {};
}

Result<void> ParameterSet::set_from_string(std::string_view assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string_view::npos) {
    return failure("\"" + std::string(assignment) + "\": must be key=value");
  }
  const std::string key(trimmed(assignment.substr(0, equals)));
  const std::string text(trimmed(assignment.substr(equals + 1)));
  const std::string shown = key + " = " + text + ": ";
  const Parameter *parameter = find(key);
  if (parameter == nullptr) {
    return failure(shown + "unknown key" + detail::suggestion(key, keys()));
  }
  const bool is_text =
      parameter->rule.type == ValueRule::Type::kString || parameter->rule.type == ValueRule::Type::kChoice;
  const bool quoted = !text.empty() && (text.front() == '"' || text.front() == '\'');
  const std::string value_text = is_text && !quoted ? detail::to_toml_text(text) : text;
  const auto table = detail::parse_toml("value = " + value_text, "");
  if (!table || table->size() != 1) {
    return failure(shown + "is not a value");
  }
  const auto value = detail::convert(*table->get("value"), parameter->rule);
  if (!value) {
    return failure(shown + value.error());
  }
  parameter->set(*value);
  return {};
}

bool ParameterSet::section_is_known(const std::string &section) const {
  return std::any_of(parameters_.begin(), parameters_.end(),
                     [&section](const Parameter &p) { return p.key.starts_with(section + "."); });
}

std::string ParameterSet::to_toml() const {
  std::string out = "# Parameters of " + program_ + ".\n";
  std::string section;
  for (const Parameter &p : parameters_) {
    if (section_of(p.key) != section) {
      section = section_of(p.key);
      out += "\n[" + section + "]\n";
    }
    const std::string range = detail::range_text(p.rule);
    out += "\n# " + sentence(p.text) + "\n# " + (range.empty() ? "" : range + "; ") + "default " +
           detail::to_toml_text(p.standard) + "\n" + name_of(p.key) + " = " + detail::to_toml_text(p.get()) + "\n";
  }
  return out;
}

std::string ParameterSet::to_markdown() const {
  std::string out = "| key | default | range | |\n| --- | --- | --- | --- |\n";
  for (const Parameter &p : parameters_) {
    out += "| `" + p.key + "` | `" + detail::to_toml_text(p.standard) + "` | " + detail::range_text(p.rule) + " | " +
           sentence(p.text) + " |\n";
  }
  return out;
}

} // namespace bregma::base
