// The parts of a case that a user may leave out, and what each of them is for.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "casefile/case.hpp"
#include "casefile/volumes/case_builder.hpp"

namespace bregma::cli {

struct CasePart {
  const char *name;
  const char *option;  // of `bregma case create`
  const char *purpose; // completes "missing: name, "
  bool navigation;     // the patient cannot be navigated without it
};

// Parts without which no case can be made, and that the user has not given.
[[nodiscard]] std::vector<CasePart> parts_to_give(const casefile::CaseSources &sources);

// Parts that a valid case does not have.
[[nodiscard]] std::vector<CasePart> missing_parts(const casefile::Case &c);

// One line per part.
[[nodiscard]] std::string parts_text(const std::vector<CasePart> &parts);
[[nodiscard]] nlohmann::json parts_json(const std::vector<CasePart> &parts);

} // namespace bregma::cli
