#include "algorithms/tissue/mesh/lattice_mesh.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/mesh/mesh_quality.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/tissue/shapes.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;
using surface::TriangleMesh;

// Every face belongs to one or two tetrahedra. The boundary faces form a closed surface without edges of four faces.
void expect_conforming_and_closed(const TetMesh &mesh) {
  std::map<std::array<int, 3>, int> faces;
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    for (int left_out = 0; left_out < 4; ++left_out) {
      std::array<int, 3> face{};
      for (int i = 0, k = 0; i < 4; ++i) {
        if (i != left_out) {
          face[static_cast<std::size_t>(k++)] = t[i];
        }
      }
      std::sort(face.begin(), face.end());
      ++faces[face];
    }
  }
  std::map<std::pair<int, int>, int> edges;
  for (const auto &[face, count] : faces) {
    ASSERT_LE(count, 2);
    if (count == 1) {
      for (std::size_t i = 0; i < 3; ++i) {
        ++edges[std::minmax(face[i], face[(i + 1) % 3])];
      }
    }
  }
  ASSERT_FALSE(edges.empty());
  for (const auto &[edge, count] : edges) {
    ASSERT_EQ(count, 2) << edge.first << " " << edge.second;
  }
}

// Euler characteristic of the boundary: 2 for a ball, 0 for a ring. It is odd or too small if two fans touch at a node.
int euler(const TetMesh &mesh) {
  const TetBoundary boundary = boundary_of(mesh);
  return static_cast<int>(boundary.nodes.size()) - static_cast<int>(boundary.triangles.size()) / 2;
}

void expect_good(const TriangleMesh &surface, const LatticeMesh &filled, double volume_tolerance) {
  const TetMesh &mesh = filled.mesh;
  ASSERT_NO_THROW(check(mesh)); // all positive
  expect_conforming_and_closed(mesh);

  const surface::SurfaceModel model(surface);
  const TetBoundary boundary = boundary_of(mesh);
  std::set<int> outer(boundary.nodes.begin(), boundary.nodes.end());
  for (int node = 0; node < static_cast<int>(mesh.nodes_mm.size()); ++node) {
    const auto closest = model.closest(mesh.nodes_mm[static_cast<std::size_t>(node)]);
    if (outer.count(node) != 0) {
      ASSERT_LT(closest.distance_mm, 1e-3 * filled.edge_mm) << node;
    } else {
      ASSERT_LT(closest.signed_mm, 0.0) << node;
    }
  }
  const MeshQuality quality = quality_of(mesh);
  EXPECT_NEAR(quality.volume_mm3 / test::enclosed_mm3(surface), 1.0, volume_tolerance);
  EXPECT_GT(quality.min_dihedral_deg, 12.0);
  EXPECT_LT(quality.max_dihedral_deg, 160.0);
  // The regular tetrahedra of the lattice have 0.354 of the edge.
  EXPECT_GT(quality.stable_length_mm, 0.22 * filled.edge_mm);
  EXPECT_GE(quality.stable_length_mm, filled.stuffed_stable_length_mm);
}

TEST(LatticeMesh, FillsASphere) {
  const TriangleMesh sphere = test::make_sphere(4, 60.0, {10.0, -20.0, 30.0});
  const LatticeMesh filled = fill_surface(sphere);
  EXPECT_NEAR(static_cast<double>(filled.mesh.tetrahedra.size()), 20'000.0, 400.0);
  expect_good(sphere, filled, 0.01);
  EXPECT_EQ(euler(filled.mesh), 2);
}

TEST(LatticeMesh, FillsARing) {
  const TriangleMesh torus = test::make_torus(50.0, 20.0, 120, 48);
  const LatticeMesh filled = fill_surface(torus);
  expect_good(torus, filled, 0.02);
  EXPECT_EQ(euler(filled.mesh), 0);
}

// Edges of a box are rounded by at most about half an edge length.
TEST(LatticeMesh, FillsABox) {
  const TriangleMesh box = test::make_box({-50.0, -30.0, 0.0}, {50.0, 30.0, 40.0});
  const LatticeMesh filled = fill_surface(box);
  expect_good(box, filled, 0.02);
  EXPECT_EQ(euler(filled.mesh), 2);
}

TEST(LatticeMesh, FillsTheBrainOfColin27) {
  const auto brain = test::colin27_brain();
  if (!brain) {
    GTEST_SKIP() << "needs ../shared/data/meshes/colin27";
  }
  for (const int wanted : {10'000, 20'000, 100'000}) {
    SCOPED_TRACE(wanted);
    const LatticeMesh filled = fill_surface(*brain, {.edge_mm = {}, .tetrahedra = wanted});
    EXPECT_NEAR(static_cast<double>(filled.mesh.tetrahedra.size()), wanted, 0.02 * wanted);
    expect_good(*brain, filled, 0.02);
    EXPECT_EQ(euler(filled.mesh), 2);
  }
}

TEST(LatticeMesh, UsesTheRequestedLatticeEdge) {
  const TriangleMesh sphere = test::make_sphere(3, 40.0, Vector3d::Zero());
  const LatticeMesh filled = fill_surface(sphere, {.edge_mm = 8.0, .smoothing_sweeps = 0});
  EXPECT_EQ(filled.edge_mm, 8.0);
  expect_conforming_and_closed(filled.mesh);
  // The interior is the regular lattice with edges of a and sqrt(3)/2 a.
  int inner = 0;
  for (const Eigen::Vector4i &t : filled.mesh.tetrahedra) {
    std::array<Vector3d, 4> p;
    for (int i = 0; i < 4; ++i) {
      p[static_cast<std::size_t>(i)] = filled.mesh.nodes_mm[static_cast<std::size_t>(t[i])];
    }
    if (std::any_of(p.begin(), p.end(), [](const Vector3d &q) { return q.norm() > 25.0; })) {
      continue;
    }
    ++inner;
    int longer = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = i + 1; j < 4; ++j) {
        const double length = (p[i] - p[j]).norm();
        longer += length > 7.5 ? 1 : 0;
        EXPECT_NEAR(length, length > 7.5 ? 8.0 : 8.0 * std::sqrt(0.75), 1e-9);
      }
    }
    EXPECT_EQ(longer, 2);
  }
  EXPECT_GT(inner, 500);
}

TEST(LatticeMesh, SmoothingLengthensTheStableStep) {
  const TriangleMesh torus = test::make_torus(50.0, 20.0, 120, 48);
  const LatticeMesh stuffed = fill_surface(torus, {.edge_mm = 7.0, .smoothing_sweeps = 0});
  const LatticeMesh smoothed = fill_surface(torus, {.edge_mm = 7.0});
  EXPECT_EQ(stuffed.mesh.tetrahedra, smoothed.mesh.tetrahedra);
  EXPECT_EQ(stable_length_mm(stuffed.mesh), smoothed.stuffed_stable_length_mm);
  EXPECT_GT(stable_length_mm(smoothed.mesh), 1.5 * stable_length_mm(stuffed.mesh));
}

TEST(LatticeMesh, TheSameSurfaceGivesTheSameMesh) {
  const TriangleMesh head = test::make_head(4);
  const LatticeMesh one = fill_surface(head, {.edge_mm = 12.0});
  const LatticeMesh two = fill_surface(head, {.edge_mm = 12.0});
  EXPECT_EQ(one.mesh.nodes_mm, two.mesh.nodes_mm);
  EXPECT_EQ(one.mesh.tetrahedra, two.mesh.tetrahedra);
}

// Many coarse lattices, with clefts and bridges as thin as an edge: the result is valid or the mesh is refused.
TEST(LatticeMesh, IsValidOrRefusedAtEveryEdgeLength) {
  const TriangleMesh torus = test::make_torus(30.0, 9.0, 90, 36);
  int made = 0;
  int refused = 0;
  for (double edge = 4.0; edge < 40.0; edge *= 1.05) {
    SCOPED_TRACE(edge);
    try {
      const LatticeMesh filled = fill_surface(torus, {.edge_mm = edge, .smoothing_sweeps = 2});
      ASSERT_NO_THROW(check(filled.mesh));
      expect_conforming_and_closed(filled.mesh);
      ++made;
    } catch (const std::invalid_argument &error) {
      EXPECT_NE(std::string(error.what()).find("is too long for this surface of 78.0 x 78.0 x 18.0 mm: "),
                std::string::npos)
          << error.what();
      ++refused;
    }
  }
  EXPECT_GT(made, 20);
  EXPECT_GT(refused, 3);
}

TEST(LatticeMesh, UnusableSurfacesAreRefusedWithTheReason) {
  const auto message = [](const TriangleMesh &surface, const LatticeMeshOptions &options) {
    try {
      (void)fill_surface(surface, options);
    } catch (const std::invalid_argument &error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const TriangleMesh sphere = test::make_sphere(3, 40.0, Vector3d::Zero());
  TriangleMesh open = sphere;
  open.triangles.pop_back();
  EXPECT_EQ(message(open, {}), "the surface is not closed: it has no inside to fill");
  TriangleMesh turned = sphere;
  for (Eigen::Vector3i &t : turned.triangles) {
    std::swap(t[0], t[1]);
  }
  EXPECT_EQ(message(turned, {}).rfind("the surface is oriented inwards: it encloses -2", 0), 0U) << message(turned, {});
  EXPECT_EQ(message(sphere, {.edge_mm = -2.0}), "edge length -2 mm: must be positive");
  EXPECT_EQ(message(sphere, {.edge_mm = NAN}), "edge length nan mm: must be positive");
  EXPECT_EQ(message(sphere, {.edge_mm = 1.0}).rfind("edge length 1 mm: gives about 31", 0), 0U)
      << message(sphere, {.edge_mm = 1.0});
  EXPECT_NE(message(sphere, {.edge_mm = 1.0}).find(" tetrahedra, at most 500000 are made"), std::string::npos);
  EXPECT_EQ(message(sphere, {.edge_mm = 400.0}),
            "edge length 400 mm: is too long for this surface of 80.0 x 80.0 x 80.0 mm: no tetrahedron fits into it");
  EXPECT_EQ(message(sphere, {.edge_mm = {}, .tetrahedra = 10}), "10 tetrahedra: must be between 500 and 500000");

  TriangleMesh two = sphere;
  const TriangleMesh other = test::make_sphere(3, 20.0, {200.0, 0.0, 0.0});
  for (const Vector3d &v : other.vertices_mm) {
    two.vertices_mm.push_back(v);
  }
  for (const Eigen::Vector3i &t : other.triangles) {
    two.triangles.emplace_back(t.array() + static_cast<int>(sphere.vertices_mm.size()));
  }
  EXPECT_NE(message(two, {.edge_mm = 8.0}).find("it falls into 2 pieces"), std::string::npos)
      << message(two, {.edge_mm = 8.0});
}

} // namespace
} // namespace bregma::tissue
