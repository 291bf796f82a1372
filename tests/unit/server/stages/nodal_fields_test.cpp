#include "server/stages/deformation/nodal_fields.hpp"

#include <gtest/gtest.h>

#include "algorithms/tissue/material/constitutive.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::server {
namespace {

// A block that is bent, so that its elements carry different stresses.
class BentBlock : public testing::Test {
protected:
  BentBlock() {
    for (int node = 0; node < solver.nodes(); ++node) {
      const Eigen::Vector3d &rest = mesh.nodes_mm[static_cast<std::size_t>(node)];
      solver.set_displacement_mm(node, {0.0, 0.0, 0.002 * rest.x() * rest.x()});
    }
  }

  tissue::TetMesh mesh = tissue::block_mesh({4, 2, 2}, {40.0, 20.0, 20.0});
  tissue::ExplicitSolver solver{mesh, tissue::named_material("linear")};
  NodalFields fields{solver};
};

TEST_F(BentBlock, AStressIsTheMeanOfTheElementsAtTheNode) {
  fields.continue_stress(solver.elements(), 7);
  ASSERT_EQ(fields.stress_time_ns(), 7);
  for (int node = 0; node < solver.nodes(); ++node) {
    double sum_Pa = 0.0;
    int count = 0;
    for (int e = 0; e < solver.elements(); ++e) {
      if ((mesh.tetrahedra[static_cast<std::size_t>(e)].array() == node).any()) {
        sum_Pa += tissue::von_mises_Pa(solver.cauchy_Pa(e));
        ++count;
      }
    }
    ASSERT_GT(sum_Pa, 0.0);
    EXPECT_NEAR(fields.von_mises_Pa()[static_cast<std::size_t>(node)], sum_Pa / count, 1e-5 * sum_Pa) << node;
  }
}

TEST_F(BentBlock, ASweepIsVisibleWhenItIsComplete) {
  const int part = solver.elements() / 4 + 1; // four make a sweep
  for (std::int64_t call = 1; call <= 3; ++call) {
    fields.continue_stress(part, call);
    EXPECT_EQ(fields.stress_time_ns(), 0);
  }
  fields.continue_stress(part, 4);
  EXPECT_EQ(fields.stress_time_ns(), 1) << "its oldest value";
  const auto first = fields.von_mises_Pa();
  solver.reset();
  fields.continue_stress(part, 5);
  EXPECT_EQ(fields.von_mises_Pa(), first);
  fields.continue_stress(solver.elements(), 6);
  EXPECT_EQ(fields.stress_time_ns(), 5);
  EXPECT_EQ(fields.von_mises_Pa(), std::vector<float>(first.size(), 0.0F));
}

TEST_F(BentBlock, AForgottenStressBeginsAgain) {
  fields.continue_stress(solver.elements(), 1);
  fields.continue_stress(1, 2);
  fields.forget_stress();
  EXPECT_EQ(fields.stress_time_ns(), 0);
  fields.continue_stress(solver.elements(), 3);
  EXPECT_EQ(fields.stress_time_ns(), 3);
}

TEST_F(BentBlock, TheDisplacementsAreThoseOfTheUpdate) {
  fields.update_displacements();
  const std::size_t last = mesh.nodes_mm.size() - 1;
  EXPECT_FLOAT_EQ(fields.displacement_mm()[3 * last + 2],
                  static_cast<float>(0.002 * mesh.nodes_mm[last].x() * mesh.nodes_mm[last].x()));
}

} // namespace
} // namespace bregma::server
