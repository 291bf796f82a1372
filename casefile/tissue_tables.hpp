// The tables [craniotomy] and [tissue] of case.toml. Private to this library.
#pragma once

#include <optional>
#include <string>

#include "casefile/case.hpp"
#include "casefile/case_check.hpp"
#include "casefile/table_reader.hpp"

namespace bregma::casefile::detail {

[[nodiscard]] CraniotomyPlan read_craniotomy(TableReader &reader);
[[nodiscard]] TissueChoice read_tissue(TableReader &reader);

// Empty where the case does not have the table.
[[nodiscard]] std::string tissue_tables_text(const Case &c);

[[nodiscard]] std::optional<CaseProblem> tissue_tables_problem(const Case &c);

} // namespace bregma::casefile::detail
