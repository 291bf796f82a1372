// Whether the parts of a case belong to one head: each part may be well-formed, and of another person, mirrored, or in
// another place.
#pragma once

#include <string>
#include <vector>

#include "casefile/case.hpp"

namespace bregma::cli {

// Sentences on parts that contradict each other or the anatomy of a human head, and on parts that are missing for a
// complete operation. Takes some hundred milliseconds.
[[nodiscard]] std::vector<std::string> find_inconsistencies(const casefile::Case &c);

} // namespace bregma::cli
