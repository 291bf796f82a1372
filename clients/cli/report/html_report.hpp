// A session as one page: text, tables and pictures in one self-contained file, without network or scripts.
#pragma once

#include <string>
#include <vector>

#include "base/result.hpp"
#include "clients/cli/report/judgement.hpp"
#include "clients/cli/report/session_analysis.hpp"

namespace bregma::cli::report {

// An error only when a picture of the head cannot be encoded.
[[nodiscard]] base::Result<std::string> html_report(const SessionAnalysis &session,
                                                    const std::vector<Judgement> &judgements);

} // namespace bregma::cli::report
