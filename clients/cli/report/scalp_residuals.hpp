// How far the traced points lie from the scalp once they are registered. Part of analyse().
#pragma once

#include "clients/cli/report/session_analysis.hpp"
#include "idl/topics.hpp"

namespace bregma::cli::report {

inline constexpr const char *kScalpAttachment = "scalp.ply"; // in whatever folder of the case

// Fills scalp and trace with the surface samples captured since since_ns and up to the acceptance. Nothing is filled,
// and nothing is wrong, when the file carries no scalp.
[[nodiscard]] base::Result<void> measure_trace(const casefile::SessionReader &reader,
                                               const wire::RegistrationState &accepted, std::int64_t since_ns,
                                               SessionAnalysis &out);

} // namespace bregma::cli::report
