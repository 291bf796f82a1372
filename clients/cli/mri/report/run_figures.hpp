// Figures of [Tuna 2022] drawn from one registration of a scanner, as HTML fragments; empty without data for them.
#pragma once

#include <string>

#include "base/result.hpp"
#include "clients/cli/mri/report/run_analysis.hpp"

namespace bregma::cli::mri_report {

[[nodiscard]] std::string correction_figure(const PhantomAnalysis &phantom);                         // 2
[[nodiscard]] base::Result<std::string> steps_figure(const PhantomAnalysis &phantom);                // 3
[[nodiscard]] base::Result<std::string> subtraction_figure(const CoilAnalysis &coils);               // 6
[[nodiscard]] base::Result<std::string> artefact_figure(const CoilAnalysis &coils);                  // 7
[[nodiscard]] std::string plane_figure(const PhantomAnalysis &phantom);                              // 11
[[nodiscard]] base::Result<std::string> map_figure(const PhantomAnalysis &phantom);                  // 12
[[nodiscard]] std::string coil_plan_figure(const PhantomAnalysis &phantom, const RunRecord &record); // 13
// The corrected slice that is nearest to the tip, beside the slice as it was acquired.
[[nodiscard]] base::Result<std::string> tip_figure(const RunRecord &record);
[[nodiscard]] std::string procedure_figure(const RunRecord &record); // steps over time

} // namespace bregma::cli::mri_report
