#include "server/inputs/device_names.hpp"

#include <algorithm>
#include <set>

#include "idl/names.hpp"

namespace bregma::inputs {
namespace {

std::string name_problem(const std::string &name, const std::set<std::string> &seen) {
  if (name.empty()) {
    return "has an empty name between commas";
  }
  if (name.size() > wire::kNameLength) {
    return "\"" + name + "\" is longer than " + std::to_string(wire::kNameLength) +
           " bytes, which the wire would have to cut";
  }
  return seen.contains(name) ? "\"" + name + "\" is named twice" : "";
}

} // namespace

base::Result<void> check_device_names(const std::vector<std::pair<const char *, std::string>> &lists) {
  std::set<std::string> seen;
  for (const auto &[key, list] : lists) {
    for (const std::string &name : split_names(list)) {
      if (const std::string problem = name_problem(name, seen); !problem.empty()) {
        return base::failure(std::string(key) + " = \"" + list + "\": " + problem);
      }
      seen.insert(name);
    }
  }
  if (seen.size() > bregma_wire_MAX_DEVICES) {
    return base::failure("devices: " + std::to_string(seen.size()) + " are named, at most " +
                         std::to_string(bregma_wire_MAX_DEVICES) + " can be shown");
  }
  return {};
}

std::vector<std::string> split_names(std::string_view list) {
  constexpr std::string_view kBlank = " \t";
  std::vector<std::string> names;
  if (list.find_first_not_of(kBlank) == std::string_view::npos) {
    return names;
  }
  while (true) {
    const std::size_t comma = list.find(',');
    std::string_view name = list.substr(0, comma);
    name.remove_prefix(std::min(name.find_first_not_of(kBlank), name.size()));
    name = name.substr(0, name.find_last_not_of(kBlank) + 1); // npos + 1 == 0: only blanks
    names.emplace_back(name);
    if (comma == std::string_view::npos) {
      return names;
    }
    list.remove_prefix(comma + 1);
  }
}

} // namespace bregma::inputs
