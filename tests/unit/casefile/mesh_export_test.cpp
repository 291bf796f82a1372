// Surfaces for other programs and printers.
#include <gtest/gtest.h>

#include "algorithms/surface/shell.hpp"
#include "casefile/mesh_file.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::casefile {
namespace {

const auto kBall = tests::sphere({10, 20, 30}, 80, 4);
const auto kFront = [](const Eigen::Vector3d &p) { return p.y() > 40.0; };

TEST(Shell, OfAPartIsWatertightAndAsThickAsWanted) {
  const surface::TriangleMesh shell = surface::shell_of(kBall, kFront, 3.0);
  const auto closed = check_closed(shell);
  ASSERT_TRUE(closed) << closed.error().message;
  double nearest = 1e9;
  double farthest = 0.0;
  for (const Eigen::Vector3d &vertex : shell.vertices_mm) {
    const double radius = (vertex - Eigen::Vector3d(10, 20, 30)).norm();
    nearest = std::min(nearest, radius);
    farthest = std::max(farthest, radius);
  }
  EXPECT_NEAR(farthest, 80.0, 0.01);
  EXPECT_NEAR(nearest, 77.0, 0.05);
}

TEST(Shell, KeepsTheLargestPieceAndIsEmptyWithoutOne) {
  const auto both_caps = [](const Eigen::Vector3d &p) { return p.y() > 40.0 || p.y() < -40.0; };
  EXPECT_EQ(surface::shell_of(kBall, both_caps, 3.0).triangles.size(),
            surface::shell_of(kBall, kFront, 3.0).triangles.size());
  EXPECT_TRUE(surface::shell_of(
                  kBall, [](const Eigen::Vector3d &) { return false; }, 3.0)
                  .triangles.empty());
}

TEST(Stl, HasEveryTriangleAndStatesItsSpace) {
  const test::TemporaryFolder folder;
  ASSERT_TRUE(write_stl(folder / "b.stl", kBall));
  const std::string bytes = tests::read_file(folder / "b.stl");
  EXPECT_EQ(bytes.size(), 84 + 50 * kBall.triangles.size());
  EXPECT_NE(bytes.substr(0, 80).find("SPACE=RAS"), std::string::npos);
  surface::TriangleMesh open = kBall;
  open.triangles.emplace_back(0, 0, 1);
  EXPECT_FALSE(write_stl(folder / "o.stl", open));
}

} // namespace
} // namespace bregma::casefile
