// Distances of the registered traced points from the scalp. Part of analyse().
#pragma once

#include "clients/cli/report/session_analysis.hpp"
#include "idl/topics.hpp"

namespace bregma::cli::report {

inline constexpr const char *kScalpAttachment = "scalp.ply"; // in any folder of the case

// Fills scalp and trace with the surface samples captured between since_ns and the acceptance. Without a scalp in the
// file nothing is filled, which is not an error.
[[nodiscard]] base::Result<void> measure_trace(const casefile::SessionReader &reader,
                                               const wire::RegistrationState &accepted, std::int64_t since_ns,
                                               SessionAnalysis &out);

} // namespace bregma::cli::report
