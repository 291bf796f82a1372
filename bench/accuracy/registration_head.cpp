#include "bench/accuracy/registration_head.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <numeric>
#include <stdexcept>

#include "casefile/mesh_file.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::bench {

namespace {
constexpr std::size_t kFaceVertices = 3000;
constexpr double kAway_mm = 200.0;
} // namespace

Head load_head(const std::string &case_folder) {
  auto mesh = casefile::read_mesh(std::filesystem::path(case_folder) / "surfaces" / "scalp.ply");
  if (!mesh) {
    throw std::runtime_error(mesh.error().message);
  }
  Head out{std::move(*mesh), {}};
  out.face = out.mesh.vertices_mm;
  const auto forward = [](const Vector3d &p) { return p.y() - 0.3 * p.z(); };
  const std::size_t count = std::min(kFaceVertices, out.face.size());
  std::nth_element(out.face.begin(), out.face.begin() + static_cast<std::ptrdiff_t>(count) - 1, out.face.end(),
                   [&](const Vector3d &a, const Vector3d &b) { return forward(a) > forward(b); });
  out.face.resize(count);
  return out;
}

double Trace::rmse_mm(const PairedPose &estimate, const std::vector<Vector3d> &at_mm) const {
  const auto error = estimate * T_target_source.inverse();
  double squares = 0.0;
  for (const Vector3d &p : at_mm) {
    squares += (error * p - p).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(at_mm.size()));
}

double Trace::error_at_10cm_mm(const PairedPose &estimate) const {
  const Vector3d line(100.0, 0.0, 0.0);
  return (T_target_source.rotation() * line - estimate.rotation() * line).norm();
}

Trace take_trace(std::vector<Vector3d> places_mm, double sigma_mm, Noise noise, std::mt19937 &rng) {
  Trace out;
  const Vector3d away = kAway_mm * test::normal_vector(rng, 1.0).normalized();
  out.T_target_source = PairedPose(test::random_rotation(rng), away);
  const auto back = out.T_target_source.inverse();
  for (const Vector3d &p : places_mm) {
    Vector3d error = test::normal_vector(rng, sigma_mm);
    if (noise == Noise::kDepth) {
      error.x() = error.z() = 0.0;
    }
    out.source_mm.push_back(back * (p + error));
  }
  out.true_mm = std::move(places_mm);
  return out;
}

std::vector<Vector3d> side_of(const Head &head, std::size_t count, bool left, std::mt19937 &rng) {
  std::vector<Vector3d> out;
  for (const auto &spot :
       test::spots(head.mesh, count, rng, [&](const Vector3d &p) { return (p.x() < 0.0) == left; })) {
    out.push_back(spot.point_mm);
  }
  return out;
}

PairedPose perturbed_start(const PairedPose &truth, const Vector3d &middle_mm, double angle_rad, double distance_mm,
                           std::mt19937 &rng) {
  const Vector3d axis = test::normal_vector(rng, 1.0).normalized();
  const Vector3d way = test::normal_vector(rng, 1.0).normalized();
  const Eigen::Quaterniond turn = geometry::rotation_exp(angle_rad * axis);
  return {turn * truth.rotation(), turn * (truth.translation() - middle_mm) + middle_mm + distance_mm * way};
}

double thread_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

} // namespace bregma::bench
