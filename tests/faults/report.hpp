// What a run has shown, as rows of a table or as one JSON object per line.
#pragma once

#include <string>

#include "tests/faults/campaign.hpp"

namespace bregma::faults {

[[nodiscard]] std::string table_header();
// The row of the run, and a line for each violation.
[[nodiscard]] std::string table_rows(const Planned &planned, const Outcome &outcome);
[[nodiscard]] std::string json_line(const Planned &planned, const Outcome &outcome);

} // namespace bregma::faults
