#include "tests/unit/algorithms/head.hpp"

#include <array>
#include <cmath>
#include <map>
#include <utility>

#include <Eigen/Cholesky>

namespace bregma::test {

namespace {

surface::TriangleMesh unit_sphere(int subdivisions) {
  const double g = 0.5 * (1.0 + std::sqrt(5.0));
  surface::TriangleMesh mesh;
  for (const auto &[x, y, z] : std::initializer_list<std::array<double, 3>>{{-1, g, 0},
                                                                            {1, g, 0},
                                                                            {-1, -g, 0},
                                                                            {1, -g, 0},
                                                                            {0, -1, g},
                                                                            {0, 1, g},
                                                                            {0, -1, -g},
                                                                            {0, 1, -g},
                                                                            {g, 0, -1},
                                                                            {g, 0, 1},
                                                                            {-g, 0, -1},
                                                                            {-g, 0, 1}}) {
    mesh.vertices_mm.push_back(Vector3d(x, y, z).normalized());
  }
  mesh.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                    {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                    {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [entry, is_new] = middles.try_emplace(std::minmax(a, b), static_cast<int>(mesh.vertices_mm.size()));
      if (is_new) {
        const Vector3d between =
            mesh.vertices_mm[static_cast<std::size_t>(a)] + mesh.vertices_mm[static_cast<std::size_t>(b)];
        mesh.vertices_mm.push_back(between.normalized());
      }
      return entry->second;
    };
    std::vector<Eigen::Vector3i> finer;
    for (const Eigen::Vector3i &t : mesh.triangles) {
      const int ab = middle(t[0], t[1]);
      const int bc = middle(t[1], t[2]);
      const int ca = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], ab, ca}, {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  return mesh;
}

} // namespace

surface::TriangleMesh make_sphere(int subdivisions, double radius_mm, const Vector3d &centre_mm) {
  surface::TriangleMesh mesh = unit_sphere(subdivisions);
  for (Vector3d &v : mesh.vertices_mm) {
    v = centre_mm + radius_mm * v;
  }
  return mesh;
}

Vector3d on_head(const Vector3d &direction) {
  const Vector3d u = direction.normalized();
  const Vector3d radii(75.0, 95.0, 105.0);
  const double skull = 1.0 / u.cwiseQuotient(radii).norm();
  const Vector3d to_nose = Vector3d(0.0, 0.95, -0.3).normalized();
  const double nose = 22.0 * std::exp(-(u - to_nose).squaredNorm() / (2.0 * 0.12 * 0.12));
  return kHeadCentre + (skull + nose) * u;
}

surface::TriangleMesh make_head(int subdivisions) {
  surface::TriangleMesh mesh = unit_sphere(subdivisions);
  for (Vector3d &v : mesh.vertices_mm) {
    v = on_head(v);
  }
  return mesh;
}

Vector3d normal_vector(std::mt19937 &rng, double sigma) {
  std::normal_distribution<double> normal(0.0, sigma);
  const double x = normal(rng);
  const double y = normal(rng);
  return {x, y, normal(rng)};
}

Vector3d draw(std::mt19937 &rng, const Matrix3d &covariance) {
  return Eigen::LLT<Matrix3d>(covariance).matrixL() * normal_vector(rng, 1.0);
}

Matrix3d random_anisotropic(std::mt19937 &rng, double lateral_mm, double depth_mm) {
  const Matrix3d R = random_rotation(rng).toRotationMatrix();
  return R * Vector3d(lateral_mm, lateral_mm, depth_mm).cwiseAbs2().asDiagonal() * R.transpose();
}

Eigen::Quaterniond random_rotation(std::mt19937 &rng) {
  const Vector3d v = normal_vector(rng, 1.0);
  std::normal_distribution<double> normal;
  return Eigen::Quaterniond(normal(rng), v.x(), v.y(), v.z()).normalized();
}

SmoothField::SmoothField(std::mt19937 &rng, double length_mm) {
  constexpr int kWaves = 100;
  std::uniform_real_distribution<double> angle(0.0, 2.0 * M_PI);
  for (int i = 0; i < kWaves; ++i) {
    wave_.push_back(normal_vector(rng, 1.0 / length_mm));
    phase_.push_back(angle(rng));
  }
}

double SmoothField::operator()(const Vector3d &point_mm) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < wave_.size(); ++i) {
    sum += std::cos(wave_[i].dot(point_mm) + phase_[i]);
  }
  return sum * std::sqrt(2.0 / static_cast<double>(wave_.size()));
}

} // namespace bregma::test
