#include "casefile/volumes/surface.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "casefile/volumes/decimation.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

using surface::TriangleMesh;

// A ball with intensity 100 in a noisy background, on an oblique anisotropic grid.
struct Phantom {
  double radius_mm = 30.0;
  double cavity_mm = 0.0;  // radius of a cavity at the centre
  double channel_mm = 0.0; // radius of a channel from the cavity upwards to the outside
  Eigen::Vector3d centre_mm{12.0, -7.0, 20.0};
};

Volume image_of(const Phantom &phantom) {
  Volume volume;
  volume.size = {76, 72, 52};
  const Eigen::Matrix3d R = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  volume.T_image_index.topLeftCorner<3, 3>() = R * Eigen::Vector3d(1.0, 1.1, 1.5).asDiagonal();
  const Eigen::Vector3d middle(37.3, 35.6, 25.4);
  volume.T_image_index.topRightCorner<3, 1>() = phantom.centre_mm - volume.T_image_index.topLeftCorner<3, 3>() * middle;
  std::mt19937 random(20);
  std::normal_distribution<float> noise(0.0F, 5.0F);
  for (int k = 0; k < volume.size[2]; ++k) {
    for (int j = 0; j < volume.size[1]; ++j) {
      for (int i = 0; i < volume.size[0]; ++i) {
        const Eigen::Vector3d from_centre = volume.point_mm({double(i), double(j), double(k)}) - phantom.centre_mm;
        const double distance = from_centre.norm();
        const bool bored = from_centre.z() > 0.0 && from_centre.head<2>().norm() < phantom.channel_mm;
        const bool speck = i < 3 && j < 3 && k < 3; // separate from the ball, must be dropped
        const bool solid = distance < phantom.radius_mm && distance >= phantom.cavity_mm && !bored;
        volume.voxels.push_back((solid || speck ? 100.0F : 0.0F) + noise(random));
      }
    }
  }
  return volume;
}

double ball_ml(double radius_mm) { return 4.0 / 3.0 * std::numbers::pi * std::pow(radius_mm, 3) / 1000.0; }

// Distances of the points from the surface, sorted.
std::vector<double> distances(const TriangleMesh &mesh, const std::vector<Eigen::Vector3d> &points) {
  const std::vector<Eigen::Vector3d> nearest = nearest_on_surface(mesh, points);
  std::vector<double> out;
  for (std::size_t at = 0; at < points.size(); ++at) {
    out.push_back((nearest[at] - points[at]).norm());
  }
  std::sort(out.begin(), out.end());
  return out;
}

void expect_body(const TriangleMesh &mesh) {
  const MeshCheck check = check_mesh(mesh);
  EXPECT_TRUE(check.closed);
  EXPECT_TRUE(check.manifold);
  EXPECT_TRUE(check.oriented);
  EXPECT_GT(check.volume_ml, 0.0);
}

TEST(Surface, BallWithCavityIsFilledClosedAndOutward) {
  const Phantom phantom{.cavity_mm = 12.0};
  SurfaceOptions options;
  options.vertices = 3000;
  const auto surface = extract_surface(image_of(phantom), options);
  ASSERT_TRUE(surface) << surface.error().message;
  expect_body(surface->mesh);
  const MeshCheck check = check_mesh(surface->mesh);
  EXPECT_EQ(1, check.components);
  EXPECT_EQ(3000U, surface->mesh.vertices_mm.size());
  EXPECT_NEAR(ball_ml(30.0), check.volume_ml, 0.01 * ball_ml(30.0));
  EXPECT_NEAR(50.0, surface->report.threshold, 35.0); // Otsu's, between the noise about 0 and about 100
  EXPECT_LT(surface->report.mean_distance_mm, 0.1);
  EXPECT_LT(surface->report.max_distance_mm, 0.5);
  for (const Eigen::Vector3d &vertex : surface->mesh.vertices_mm) {
    EXPECT_NEAR(30.0, (vertex - phantom.centre_mm).norm(), 0.8);
  }
}

TEST(Surface, HolesStayWhereTheyAreWanted) {
  SurfaceOptions options;
  options.fill_holes = false;
  options.vertices = 4000;
  const auto surface = extract_surface(image_of({.cavity_mm = 15.0}), options);
  ASSERT_TRUE(surface) << surface.error().message;
  const MeshCheck check = check_mesh(surface->mesh);
  EXPECT_TRUE(check.closed && check.manifold && check.oriented);
  EXPECT_EQ(2, check.components);
  EXPECT_NEAR(ball_ml(30.0) - ball_ml(15.0), check.volume_ml, 0.015 * ball_ml(30.0));
}

// The channel connects the cavity with the outside: only closing fills the cavity.
TEST(Surface, ClosingShutsAChannel) {
  const Volume image = image_of({.cavity_mm = 12.0, .channel_mm = 3.0});
  SurfaceOptions options;
  options.vertices = 3000;
  const auto open = extract_surface(image, options);
  ASSERT_TRUE(open) << open.error().message;
  expect_body(open->mesh);
  EXPECT_LT(open->report.volume_ml, 0.95 * ball_ml(30.0));
  options.closing_mm = 5.0;
  const auto shut = extract_surface(image, options);
  ASSERT_TRUE(shut) << shut.error().message;
  expect_body(shut->mesh);
  EXPECT_NEAR(ball_ml(30.0), shut->report.volume_ml, 0.015 * ball_ml(30.0));
}

// The image ends within the ball, where the cavity is open: the cut is closed by a plane.
TEST(Surface, ACutByTheImageBorderIsClosed) {
  Volume image = image_of({.cavity_mm = 14.0});
  const int kept = 26; // of 52 slices
  image.voxels.erase(image.voxels.begin(),
                     image.voxels.begin() + static_cast<std::ptrdiff_t>(image.offset(0, 0, kept)));
  image.size[2] -= kept;
  image.T_image_index.col(3) += double(kept) * image.T_image_index.col(2);
  SurfaceOptions options;
  options.vertices = 3000;
  options.fill_slices = true;
  const auto surface = extract_surface(image, options);
  ASSERT_TRUE(surface) << surface.error().message;
  expect_body(surface->mesh);
  EXPECT_EQ(1, check_mesh(surface->mesh).components);
  // Half a ball without the slab between its centre and the first slice's lower side.
  const double height = (25.4 - (kept - 0.5)) * 1.5;
  const double slab_ml = std::numbers::pi * (900.0 * -height - std::pow(-height, 3) / 3.0) / 1000.0;
  EXPECT_NEAR(0.5 * ball_ml(30.0) - slab_ml, surface->report.volume_ml, 0.015 * ball_ml(30.0));
}

TEST(Surface, DoesNotDependOnTheGridsHandedness) {
  const Volume image = image_of({});
  Volume mirrored = image; // the same voxels stored in reverse order of i
  for (int k = 0; k < image.size[2]; ++k) {
    for (int j = 0; j < image.size[1]; ++j) {
      const auto row = mirrored.voxels.begin() + static_cast<std::ptrdiff_t>(image.offset(0, j, k));
      std::reverse(row, row + image.size[0]);
    }
  }
  mirrored.T_image_index.col(3) += (image.size[0] - 1.0) * image.T_image_index.col(0);
  mirrored.T_image_index.col(0) *= -1.0;
  SurfaceOptions options;
  options.vertices = 2000;
  const auto a = extract_surface(image, options);
  const auto b = extract_surface(mirrored, options);
  ASSERT_TRUE(a && b);
  expect_body(b->mesh);
  EXPECT_NEAR(a->report.volume_ml, b->report.volume_ml, 1e-3 * a->report.volume_ml);
  EXPECT_LT(distances(a->mesh, b->mesh.vertices_mm).back(), 0.3);
}

TEST(Surface, RegionsKeepTheirVolumeThoughThin) {
  LabelVolume labels;
  labels.size = {60, 50, 40};
  labels.T_image_index(0, 3) = -30.0;
  labels.voxels.assign(std::size_t{60} * 50 * 40, 0);
  int marked = 0;
  for (int i = 10; i < 50; ++i) { // two separate plates of four voxels
    for (int j = 8; j < 40; ++j) {
      for (const int k : {10, 11, 12, 13, 24, 25, 26, 27}) {
        labels.voxels[labels.offset(i, j, k)] = k < 20 ? std::int16_t{7} : std::int16_t{9};
        ++marked;
      }
    }
  }
  const std::int16_t both[] = {7, 9};
  const auto surface = extract_surface(labels, both, {.closing_mm = 1.0, .vertices = 2000});
  ASSERT_TRUE(surface) << surface.error().message;
  expect_body(surface->mesh);
  EXPECT_EQ(2, check_mesh(surface->mesh).components);
  EXPECT_NEAR(marked / 1000.0, surface->report.volume_ml, 0.06 * marked / 1000.0); // the rounded rims
  const std::int16_t absent[] = {8};
  const auto none = extract_surface(labels, absent, {});
  ASSERT_FALSE(none);
  EXPECT_EQ("no voxel carries the label", none.error().message);
}

// The structures of the demonstration, with sizes at which VTK's decimation pinches some of them.
TEST(Surface, DecimationKeepsItClosed) {
  const auto labels = read_labels(test::templates() / "aal.nii.gz");
  if (!labels) {
    GTEST_SKIP() << "needs mricron-data";
  }
  const std::vector<std::vector<std::int16_t>> structures{{1},  {2}, {43, 45, 47, 49, 51, 53}, {44, 46, 48, 50, 52, 54},
                                                          {79}, {80}};
  for (const int vertices : {100, 500, 1'500, 4'000}) {
    for (const auto &regions : structures) {
      const auto surface = extract_surface(*labels, regions, {.closing_mm = 1.0, .blur_mm = 0.7, .vertices = vertices});
      ASSERT_TRUE(surface) << "region " << regions[0] << ", " << vertices << ": " << surface.error().message;
      expect_body(surface->mesh);
      EXPECT_LE(surface->mesh.vertices_mm.size(), static_cast<std::size_t>(vertices));
    }
  }
}

// Voxels at random touch each other at edges and corners.
TEST(Surface, RoughRegionsAreClosedAtEveryBlur) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    std::mt19937 random(seed);
    LabelVolume labels;
    labels.size = {20, 20, 20};
    for (int i = 0; i < 8'000; ++i) {
      labels.voxels.push_back(random() % 5 < 2 ? std::int16_t{1} : std::int16_t{0});
    }
    const std::int16_t one[] = {1};
    for (const double blur_mm : {0.0, 0.5, 0.7, 1.0}) {
      const auto surface = extract_surface(labels, one, {.fill_holes = false, .blur_mm = blur_mm, .vertices = 1'000});
      ASSERT_TRUE(surface) << "seed " << seed << ", blur " << blur_mm << ": " << surface.error().message;
      const MeshCheck check = check_mesh(surface->mesh);
      EXPECT_TRUE(check.closed && check.manifold && check.oriented);
    }
  }
}

// A torus: a collapse that closed its hole, or pinched it, would change Euler's characteristic.
TEST(Decimation, KeepsAHoleDownToTheLeastMesh) {
  TriangleMesh torus;
  const int around = 120;
  const int across = 60;
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < across; ++j) {
      const double u = 2.0 * std::numbers::pi * i / around;
      const double v = 2.0 * std::numbers::pi * j / across;
      const double r = 40.0 + 15.0 * std::cos(v);
      torus.vertices_mm.emplace_back(r * std::cos(u), r * std::sin(u), 15.0 * std::sin(v));
      const int a = i * across + j;
      const int b = (i + 1) % around * across + j;
      const int c = (i + 1) % around * across + (j + 1) % across;
      const int d = i * across + (j + 1) % across;
      torus.triangles.emplace_back(a, b, c);
      torus.triangles.emplace_back(a, c, d);
    }
  }
  ASSERT_TRUE(check_mesh(torus).manifold);
  for (const int vertices : {3'000, 500, 100, 30, 4}) {
    const TriangleMesh reduced = decimated(torus, vertices);
    expect_body(reduced);
    EXPECT_EQ(reduced.triangles.size(), 2 * reduced.vertices_mm.size()) << vertices; // characteristic 0
    if (vertices >= 100) {
      EXPECT_EQ(reduced.vertices_mm.size(), static_cast<std::size_t>(vertices));
      EXPECT_LT(distances(reduced, torus.vertices_mm).back(), vertices >= 500 ? 0.7 : 4.0) << vertices;
    }
  }
}

TEST(Surface, ShowsProgressAndStops) {
  const Volume image = image_of({});
  double last = -1.0;
  int calls = 0;
  ASSERT_TRUE(extract_surface(image, {.vertices = 1000}, [&](double done, std::string_view stage) {
    EXPECT_GE(done, last);
    EXPECT_FALSE(stage.empty());
    last = done;
    ++calls;
    return true;
  }));
  EXPECT_DOUBLE_EQ(1.0, last);
  EXPECT_GE(calls, 6);
  const auto stopped = extract_surface(image, {}, [](double done, std::string_view) { return done < 0.5; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ("stopped", stopped.error().message);
}

TEST(Surface, ErrorsAreReportedWithTheReason) {
  const Volume image = image_of({});
  EXPECT_EQ("no voxel is above the threshold of 500.000", extract_surface(image, {.threshold = 500.0}).error().message);
  EXPECT_EQ("a surface needs at least 100 vertices, a closing of 0 to 50 mm and a blur of 0 to 10 mm",
            extract_surface(image, {.vertices = 3}).error().message);
}

TriangleMesh tetrahedron(const Eigen::Vector3d &at) {
  return {{at, at + Eigen::Vector3d(30, 0, 0), at + Eigen::Vector3d(0, 30, 0), at + Eigen::Vector3d(0, 0, 30)},
          {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
}

TEST(CheckMesh, FindsEachDefect) {
  const TriangleMesh good = tetrahedron({1, 2, 3});
  MeshCheck check = check_mesh(good);
  EXPECT_TRUE(check.closed && check.manifold && check.oriented);
  EXPECT_NEAR(4.5, check.volume_ml, 1e-12);

  TriangleMesh open = good;
  open.triangles.pop_back();
  EXPECT_FALSE(check_mesh(open).closed);

  TriangleMesh flipped = good;
  std::swap(flipped.triangles[1][0], flipped.triangles[1][1]);
  EXPECT_TRUE(check_mesh(flipped).closed);
  EXPECT_FALSE(check_mesh(flipped).oriented);

  TriangleMesh inside_out = good;
  for (Eigen::Vector3i &triangle : inside_out.triangles) {
    std::swap(triangle[0], triangle[1]);
  }
  check = check_mesh(inside_out);
  EXPECT_TRUE(check.closed && check.manifold);
  EXPECT_FALSE(check.oriented);

  TriangleMesh touching = good; // two bodies that share a vertex
  const TriangleMesh other = tetrahedron({31, 2, 3});
  touching.vertices_mm.insert(touching.vertices_mm.end(), other.vertices_mm.begin() + 1, other.vertices_mm.end());
  for (const Eigen::Vector3i &triangle : other.triangles) {
    touching.triangles.push_back(triangle.unaryExpr([](int v) { return v == 0 ? 1 : v + 3; }));
  }
  check = check_mesh(touching);
  EXPECT_TRUE(check.closed && check.oriented);
  EXPECT_FALSE(check.manifold);

  EXPECT_FALSE(check_mesh({}).closed);
  TriangleMesh out_of_range = good;
  out_of_range.triangles[0][0] = 99;
  EXPECT_FALSE(check_mesh(out_of_range).closed);
}

} // namespace
} // namespace bregma::casefile
