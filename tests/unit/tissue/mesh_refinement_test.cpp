#include "algorithms/tissue/mesh/mesh_refinement.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/tissue/mesh/lattice_mesh.hpp"
#include "algorithms/tissue/mesh/mesh_quality.hpp"
#include "algorithms/tissue/mesh/mesh_topology.hpp"
#include "tests/unit/tissue/shapes.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

double boundary_mm2(const TetMesh &mesh) {
  double sum = 0.0;
  for (const Eigen::Vector3i &t : boundary_of(mesh).triangles) {
    const auto node = [&](int i) -> const Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
    sum += 0.5 * (node(1) - node(0)).cross(node(2) - node(0)).norm();
  }
  return sum;
}

double longest_edge_within_mm(const TetMesh &mesh, const RefinementRegion &place) {
  double longest = 0.0;
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    const auto node = [&](int i) -> const Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
    bool near = false;
    for (int i = 0; i < 4; ++i) {
      near = near || (node(i) - place.centre_mm).norm() < place.radius_mm;
    }
    for (int i = 0; near && i < 4; ++i) {
      for (int j = 0; j < i; ++j) {
        longest = std::max(longest, (node(i) - node(j)).norm());
      }
    }
  }
  return longest;
}

class Refinement : public testing::Test {
protected:
  TetMesh coarse = fill_surface(test::make_box({-40, -30, -20}, {40, 30, 20}), {.edge_mm = 10.0}).mesh;
  std::vector<RefinementRegion> places{{{38, 0, 0}, 12.0, 4.0}, {{38, 0, 0}, 6.0, 2.0}};
};

TEST_F(Refinement, IsFineInTheRegionAndConforming) {
  const TetMesh fine = refined(coarse, places);
  check(fine);
  EXPECT_EQ(topology_problem(fine), "");
  // A hanging node would leave interior faces with only one tetrahedron.
  EXPECT_NEAR(boundary_mm2(fine), boundary_mm2(coarse), 1e-6 * boundary_mm2(coarse));
  EXPECT_NEAR(volume_mm3(fine), volume_mm3(coarse), 1e-9 * volume_mm3(coarse));
  for (const RefinementRegion &place : places) {
    EXPECT_GT(longest_edge_within_mm(coarse, place), 2.0 * place.edge_mm);
    EXPECT_LE(longest_edge_within_mm(fine, place), place.edge_mm);
  }
  const RefinementRegion far{{-40, 0, 0}, 20.0, 1.0};
  EXPECT_EQ(longest_edge_within_mm(fine, far), longest_edge_within_mm(coarse, far)) << "elsewhere all is as it was";
  EXPECT_LT(fine.tetrahedra.size(), 20'000U) << "from 8,160";
}

TEST_F(Refinement, KeepsExistingNodes) {
  const TetMesh fine = refined(coarse, places);
  ASSERT_GT(fine.nodes_mm.size(), coarse.nodes_mm.size());
  EXPECT_TRUE(std::equal(coarse.nodes_mm.begin(), coarse.nodes_mm.end(), fine.nodes_mm.begin()));
  const TetMesh again = refined(coarse, places);
  EXPECT_TRUE(again.nodes_mm == fine.nodes_mm && again.tetrahedra == fine.tetrahedra);
  const TetMesh untouched = refined(coarse, {});
  EXPECT_TRUE(untouched.nodes_mm == coarse.nodes_mm && untouched.tetrahedra == coarse.tetrahedra);
}

TEST_F(Refinement, QualityIsBoundedAtEveryDepth) {
  const MeshQuality before = quality_of(coarse);
  for (const double edge_mm : {5.0, 2.5, 1.25}) {
    const RefinementRegion place{{38, 28, 18}, 4.0, edge_mm}; // at a corner, where the lattice is cut
    const MeshQuality after = quality_of(refined(coarse, {&place, 1}));
    EXPECT_GT(after.min_dihedral_deg, 0.5 * before.min_dihedral_deg) << edge_mm;
    EXPECT_GT(after.min_radius_ratio, 0.3 * before.min_radius_ratio) << edge_mm;
  }
}

TEST_F(Refinement, ImpossibleRegionsAreRefused) {
  const auto refusal = [this](const RefinementRegion &place) {
    try {
      (void)refined(coarse, {&place, 1});
    } catch (const std::invalid_argument &error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  const std::string wanted = ": a place, a radius and an edge must be finite, the last two positive";
  EXPECT_EQ(refusal({{0, 0, 0}, 0.0, 1.0}), "mesh refinement: radius 0.000000 mm, edge 1.000000 mm" + wanted);
  EXPECT_NE(refusal({{0, 0, 0}, 5.0, -1.0}).find(wanted), std::string::npos);
  EXPECT_NE(refusal({{0, geometry::kUnknown, 0}, 5.0, 1.0}).find(wanted), std::string::npos);
  EXPECT_EQ(refusal({{0, 0, 0}, 20.0, 0.2}), "mesh refinement: more than 500000 tetrahedra");
}

} // namespace
} // namespace bregma::tissue
