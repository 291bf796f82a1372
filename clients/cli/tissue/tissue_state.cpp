#include "clients/cli/tissue/tissue_state.hpp"

#include <utility>

#include "algorithms/tissue/material/constitutive.hpp"
#include "casefile/tissue_files/tet_file.hpp"

namespace bregma::cli {

base::Result<void> write_state(const std::filesystem::path &file, const tissue::ExplicitSolver &solver) {
  casefile::TetField displacement{"displacement_mm", 3, {}};
  for (int node = 0; node < solver.nodes(); ++node) {
    const Eigen::Vector3d u = solver.displacement_mm(node);
    displacement.values.insert(displacement.values.end(), {u.x(), u.y(), u.z()});
  }
  casefile::TetField von_mises{"von_mises_Pa", 1, {}};
  casefile::TetField cauchy{"cauchy_Pa", 6, {}};
  for (int element = 0; element < solver.elements(); ++element) {
    const Eigen::Matrix3d s = solver.cauchy_Pa(element);
    von_mises.values.push_back(tissue::von_mises_Pa(s));
    cauchy.values.insert(cauchy.values.end(), {s(0, 0), s(1, 1), s(2, 2), s(0, 1), s(1, 2), s(0, 2)});
  }
  const casefile::TetField nodes[] = {std::move(displacement)};
  const casefile::TetField cells[] = {std::move(von_mises), std::move(cauchy)};
  return casefile::write_tet_mesh(file, solver.mesh(), nodes, cells);
}

} // namespace bregma::cli
