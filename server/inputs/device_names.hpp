// Lists of device names as parameters hold them: "Tracker, Vega".
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/result.hpp"

namespace bregma::inputs {

// Split at commas, without the blanks around a name. An empty list has no names; "A," has an empty one.
[[nodiscard]] std::vector<std::string> split_names(std::string_view list);

// lists: parameter key and its value. An error names key, value and name: empty between commas, too long for the wire,
// named twice in any of the lists, or more devices than SystemHealth shows.
[[nodiscard]] base::Result<void> check_device_names(const std::vector<std::pair<const char *, std::string>> &lists);

} // namespace bregma::inputs
