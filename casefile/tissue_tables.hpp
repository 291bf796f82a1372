// The tables [craniotomy] and [tissue] of case.toml. Private to this library.
#pragma once

#include <optional>
#include <string>

#include "base/table_reader.hpp"
#include "casefile/case.hpp"
#include "casefile/case_check.hpp"

namespace bregma::casefile::detail {

[[nodiscard]] CraniotomyPlan read_craniotomy(base::TableReader &reader);
[[nodiscard]] TissueChoice read_tissue(base::TableReader &reader);

// Empty where the case does not have the table.
[[nodiscard]] std::string tissue_tables_text(const Case &c);

[[nodiscard]] std::optional<CaseProblem> tissue_tables_problem(const Case &c);

} // namespace bregma::casefile::detail
