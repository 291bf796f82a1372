// What a tissue model has computed, as fields of a file.
#pragma once

#include <filesystem>

#include "algorithms/tissue/solver/explicit_solver.hpp"
#include "base/result.hpp"

namespace bregma::cli {

// The present state of the tissue, on its mesh at rest: displacement_mm; von_mises_Pa and cauchy_Pa.
[[nodiscard]] base::Result<void> write_state(const std::filesystem::path &file, const tissue::ExplicitSolver &solver);

} // namespace bregma::cli
