// What a run has shown, as rows of a table or as one JSON object per line.
#pragma once

#include <string>

#include "tests/faults/campaign.hpp"
#include "tests/faults/kills.hpp"

namespace bregma::faults {

[[nodiscard]] std::string table_header();
// The row of the run, and a line for each violation.
[[nodiscard]] std::string table_rows(const Planned &planned, const Outcome &outcome);
[[nodiscard]] std::string json_line(const Planned &planned, const Outcome &outcome);

// A kill of the real daemon.
[[nodiscard]] std::string table_row(int number, const Kill &kill, bool holds);
[[nodiscard]] std::string json_line(int number, const Kill &kill, bool holds);

} // namespace bregma::faults
