#include "algorithms/tissue/mesh/mesh_quality.hpp"

#include <cmath>
#include <numeric>
#include <random>
#include <stdexcept>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

// Edge length sqrt(8).
TetMesh regular() { return {{{1, 1, 1}, {-1, 1, -1}, {1, -1, -1}, {-1, -1, 1}}, {{0, 1, 2, 3}}}; }

TEST(MeshQuality, OfARegularTetrahedron) {
  const MeshQuality q = quality_of(regular());
  const double edge = std::sqrt(8.0);
  const double angle = std::acos(1.0 / 3.0) * 180.0 / M_PI;
  EXPECT_EQ(q.nodes, 4);
  EXPECT_EQ(q.tetrahedra, 1);
  EXPECT_EQ(q.boundary_nodes, 4);
  EXPECT_EQ(q.boundary_triangles, 4);
  EXPECT_NEAR(q.volume_mm3, edge * edge * edge / (6.0 * std::sqrt(2.0)), 1e-12);
  EXPECT_NEAR(q.min_dihedral_deg, angle, 1e-9);
  EXPECT_NEAR(q.max_dihedral_deg, angle, 1e-9);
  EXPECT_EQ(q.dihedral_histogram[7], 6);
  EXPECT_NEAR(q.min_radius_ratio, 1.0, 1e-12);
  EXPECT_NEAR(q.mean_radius_ratio, 1.0, 1e-12);
  EXPECT_NEAR(q.min_edge_mm, edge, 1e-12);
  EXPECT_NEAR(q.max_edge_mm, edge, 1e-12);
  EXPECT_NEAR(q.min_altitude_mm, std::sqrt(2.0 / 3.0) * edge, 1e-12);
  EXPECT_NEAR(q.stable_length_mm, 0.5 * q.min_altitude_mm, 1e-12);
}

TEST(MeshQuality, OfACornerOfACube) {
  const MeshQuality q = quality_of({{{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 0, 2}}, {{0, 1, 2, 3}}});
  EXPECT_NEAR(q.max_dihedral_deg, 90.0, 1e-9);
  EXPECT_NEAR(q.min_dihedral_deg, std::acos(1.0 / std::sqrt(3.0)) * 180.0 / M_PI, 1e-9);
  EXPECT_EQ(q.dihedral_histogram[5], 3);
  EXPECT_EQ(std::accumulate(q.dihedral_histogram.begin(), q.dihedral_histogram.end(), 0), 6);
  const double inradius = 2.0 / (3.0 + std::sqrt(3.0)); // 3 V / A: V = 4/3, A = 3 * 2 + 2 sqrt(3)
  EXPECT_NEAR(q.min_radius_ratio, 3.0 * inradius / std::sqrt(3.0), 1e-12);
  EXPECT_NEAR(q.min_altitude_mm, 2.0 / std::sqrt(3.0), 1e-12);
  // Altitudes 2, 2, 2 and 2 / sqrt(3).
  EXPECT_NEAR(q.stable_length_mm, 1.0 / std::sqrt(3.0 / 4.0 + 3.0 / 4.0), 1e-12);
}

TEST(MeshQuality, APercentileIsOfAllTetrahedra) {
  TetMesh block = block_mesh({5, 5, 4}, {5.0, 5.0, 4.0});
  const MeshQuality even = quality_of(block);
  EXPECT_NEAR(even.percentile5_radius_ratio, even.min_radius_ratio, 1e-12);
  block.nodes_mm[0].x() = 0.8; // flattens two tetrahedra at one corner
  const MeshQuality one_bad = quality_of(block);
  EXPECT_LT(one_bad.min_radius_ratio, 0.7 * even.min_radius_ratio);
  EXPECT_NEAR(one_bad.percentile5_radius_ratio, even.min_radius_ratio, 1e-9);
}

TEST(MeshQuality, RadiusRatiosAreThoseOfTheTetrahedra) {
  TetMesh block = block_mesh({2, 2, 2}, {2.0, 2.0, 2.0});
  block.nodes_mm[0].x() = 0.8;
  const std::vector<double> ratios = radius_ratios(block);
  ASSERT_EQ(ratios.size(), block.tetrahedra.size());
  for (std::size_t i = 0; i < ratios.size(); ++i) {
    TetMesh one{{}, {{0, 1, 2, 3}}};
    for (int k = 0; k < 4; ++k) {
      one.nodes_mm.push_back(block.nodes_mm[static_cast<std::size_t>(block.tetrahedra[i][k])]);
    }
    EXPECT_NEAR(ratios[i], quality_of(one).mean_radius_ratio, 1e-12);
  }
}

TEST(MeshQuality, ABadMeshIsRefused) { EXPECT_THROW((void)quality_of({}), std::invalid_argument); }

// The largest frequency w of one free element with lumped masses, from its stiffness matrix. The stable step is at most
// 2 / w, and close to it for the worst shape.
TEST(StableStep, HoldsForTheElementsOwnFrequencies) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> coordinate(-1.0, 1.0);
  const Material &material = named_material("thesis");
  const double lambda = material.bulk_Pa() - 2.0 / 3.0 * material.shear_Pa();
  const double mu = material.shear_Pa();
  double tightest = 0.0;
  for (int i = 0; i < 1000; ++i) {
    TetMesh mesh = regular();
    for (Vector3d &node : mesh.nodes_mm) {
      node += 0.6 * Vector3d(coordinate(rng), coordinate(rng), coordinate(rng));
    }
    const double volume = volume_mm3(mesh) * 1e-9;
    if (volume < 1e-11) {
      continue;
    }
    Eigen::Matrix3d edges;
    for (int k = 0; k < 3; ++k) {
      edges.col(k) = 1e-3 * (mesh.nodes_mm[static_cast<std::size_t>(k) + 1] - mesh.nodes_mm[0]);
    }
    Eigen::Matrix<double, 3, 4> gradient;
    gradient.rightCols<3>() = edges.inverse().transpose();
    gradient.col(0) = -gradient.rightCols<3>().rowwise().sum();
    Eigen::Matrix<double, 12, 12> stiffness;
    for (Eigen::Index a = 0; a < 4; ++a) {
      for (Eigen::Index b = 0; b < 4; ++b) {
        const Vector3d ga = gradient.col(a);
        const Vector3d gb = gradient.col(b);
        stiffness.block<3, 3>(3 * a, 3 * b) = volume * (lambda * ga * gb.transpose() + mu * gb * ga.transpose() +
                                                        mu * ga.dot(gb) * Eigen::Matrix3d::Identity());
      }
    }
    const double lumped_kg = material.density_kg_m3 * volume / 4.0;
    const double w2 =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 12, 12>>(stiffness).eigenvalues()[11] / lumped_kg;
    const double limit_s = 2.0 / std::sqrt(w2);
    const double step_s = stable_step_s(stable_length_mm(mesh), material);
    ASSERT_LE(step_s, limit_s * (1.0 + 1e-12));
    tightest = std::max(tightest, step_s / limit_s);
  }
  EXPECT_GT(tightest, 0.93);
}

TEST(StableStep, IsThatOfTheWave) {
  Material material;
  material.name = "unit";
  material.young_Pa = 4000.0;
  material.poisson = 0.0; // K + 4/3 mu = E
  material.density_kg_m3 = 1000.0;
  EXPECT_NEAR(stable_step_s(3.0, material), 3e-3 / 2.0, 1e-12);
  material.poisson = 0.5;
  EXPECT_THROW((void)stable_step_s(3.0, material), std::invalid_argument);
}

} // namespace
} // namespace bregma::tissue
