// Requirements on a case before it is used for navigation. Private to this library.
#pragma once

#include <optional>
#include <string>

#include "casefile/case.hpp"

namespace bregma::casefile::detail {

struct CaseProblem {
  std::string key; // key in case.toml, for example "tools[2].markers_mm"
  std::string what;
};

// The first problem in the order of the file.
[[nodiscard]] std::optional<CaseProblem> find_problem(const Case &c);

} // namespace bregma::casefile::detail
