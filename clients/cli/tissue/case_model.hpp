// A tissue model of a case's brain as the daemon would make it, and what it computed as fields of a file.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"
#include "casefile/case.hpp"
#include "casefile/tissue_files/tet_file.hpp"
#include "clients/cli/tissue/brain_mesh.hpp"

namespace bregma::cli {

// Craniotomy and material of the case; all else is the model's default.
[[nodiscard]] base::Result<std::unique_ptr<tissue::BrainModel>>
make_model(const casefile::Case &c, const tissue::LatticeMesh &filled, std::span<const Eigen::Vector3d> points_mm);

// The present state of the tissue, on its mesh at rest: displacement_mm; von_mises_Pa and cauchy_Pa.
[[nodiscard]] base::Result<void> write_state(const std::filesystem::path &file, const tissue::ExplicitSolver &solver);

} // namespace bregma::cli
