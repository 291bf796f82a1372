#include "algorithms/tissue/mesh/tet_mesh.hpp"

#include <stdexcept>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace bregma::tissue {
namespace {

TEST(TetMesh, ABlockIsFilledAndItsSurfaceIsClosed) {
  const TetMesh block = block_mesh({3, 2, 4}, {30.0, 10.0, 20.0});
  EXPECT_NO_THROW(check(block));
  EXPECT_EQ(block.tetrahedra.size(), 3U * 2U * 4U * 6U);
  EXPECT_NEAR(volume_mm3(block), 6000.0, 1e-9);

  const TetBoundary boundary = boundary_of(block);
  EXPECT_EQ(boundary.triangles.size(), 2U * 2U * (3U * 2U + 2U * 4U + 3U * 4U));
  double six_volumes = 0.0; // divergence theorem: gives the volume only for a closed surface with outward normals
  for (const Eigen::Vector3i &t : boundary.triangles) {
    const auto node = [&](int i) { return block.nodes_mm[static_cast<std::size_t>(t[i])]; };
    six_volumes += node(0).dot(node(1).cross(node(2)));
  }
  EXPECT_NEAR(six_volumes / 6.0, 6000.0, 1e-9);
  EXPECT_EQ(boundary.nodes.size(), 4U * 3U * 5U - 2U * 1U * 3U);
}

TEST(TetMesh, ErrorsAreReported) {
  const auto message = [](auto &&spoil) {
    TetMesh mesh = block_mesh({1, 1, 1}, {1.0, 1.0, 1.0});
    spoil(mesh);
    try {
      check(mesh);
    } catch (const std::invalid_argument &error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message([](TetMesh &m) { m.tetrahedra.clear(); }), "mesh without tetrahedra");
  EXPECT_EQ(message([](TetMesh &m) { m.nodes_mm[3].x() = NAN; }), "node 3 is not finite");
  EXPECT_EQ(message([](TetMesh &m) { m.tetrahedra[2][1] = 8; }), "tetrahedron 2 names node 8 of 8");
  EXPECT_EQ(message([](TetMesh &m) { std::swap(m.tetrahedra[1][0], m.tetrahedra[1][1]); }),
            "tetrahedron 1 has a volume of -0.166667 mm^3, must be positive");
  EXPECT_EQ(message([](TetMesh &m) { m.nodes_mm.emplace_back(5.0, 5.0, 5.0); }), "node 8 belongs to no tetrahedron");
}

} // namespace
} // namespace bregma::tissue
