// The figures of a session as text for a terminal and as JSON.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "clients/cli/report/judgement.hpp"
#include "clients/cli/report/session_analysis.hpp"

namespace bregma::cli::report {

[[nodiscard]] std::string summary_text(const SessionAnalysis &session, const std::vector<Judgement> &judgements);
// Unknown values are null.
[[nodiscard]] nlohmann::json summary_json(const SessionAnalysis &session, const std::vector<Judgement> &judgements);

// "2.31 mm"; for yes or no "yes"; "not known" if the file does not contain it.
[[nodiscard]] std::string value_text(const Judgement &judgement);
[[nodiscard]] std::string limit_text(const Judgement &judgement); // "at most 3 mm", "required"

} // namespace bregma::cli::report
