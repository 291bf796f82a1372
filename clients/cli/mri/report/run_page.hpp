// One registration of a scanner as a page and as text.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "base/result.hpp"
#include "clients/cli/mri/report/run_analysis.hpp"
#include "clients/cli/report/judgement.hpp"

namespace bregma::cli::mri_report {

// What has to hold for a good run: accepted and valid, residual of the field (14), and where the truth is known the
// errors within what was predicted.
[[nodiscard]] std::vector<report::Judgement> judge(const RunRecord &record, const RunInputs &inputs,
                                                   const RunAnalysis &analysis);

[[nodiscard]] std::string summary_text(const RunRecord &record, const RunAnalysis &analysis,
                                       const std::vector<report::Judgement> &judgements);
[[nodiscard]] nlohmann::json summary_json(const RunRecord &record, const RunAnalysis &analysis,
                                          const std::vector<report::Judgement> &judgements);
// An error only when a picture cannot be encoded.
[[nodiscard]] base::Result<std::string> html_page(const RunRecord &record, const RunAnalysis &analysis,
                                                  const std::vector<report::Judgement> &judgements);

} // namespace bregma::cli::mri_report
