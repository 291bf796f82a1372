#include "algorithms/registration/surface/plane_step.hpp"

#include <algorithm>
#include <limits>

#include <Eigen/Cholesky>

#include "algorithms/registration/surface/plane_kernel.hpp"

namespace bregma::registration {

using geometry::Vector6d;

namespace {

const PlaneKernel &kernel() noexcept {
  static const PlaneKernel &widest = plane_kernels().front();
  return widest;
}

PlaneQuery query(const surface::SurfaceField &field, const SampleLanes &samples, std::size_t count,
                 const PairedPose &T) {
  PlaneQuery out{field.grid(), samples.axis(0), samples.axis(1), samples.axis(2), count, {}, {}};
  Eigen::Map<Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(out.rotation.data()) = T.rotation_matrix().cast<float>();
  Eigen::Vector3f::Map(out.translation.data()) = T.translation().cast<float>();
  return out;
}

} // namespace

std::size_t whole_lanes(std::size_t count) noexcept { return (count + kPlaneLanes - 1) / kPlaneLanes * kPlaneLanes; }

float ranked(std::span<float> values, std::size_t count, std::size_t rank) noexcept {
  std::fill(values.begin() + static_cast<std::ptrdiff_t>(count),
            values.begin() + static_cast<std::ptrdiff_t>(whole_lanes(count)), std::numeric_limits<float>::infinity());
  return kernel().ranked(values.data(), count, rank);
}

void SampleLanes::reserve(std::size_t capacity) {
  capacity_ = capacity;
  for (std::vector<float> &axis : axes_) {
    axis.resize(whole_lanes(capacity));
  }
}

PlaneStep plane_step(const surface::SurfaceField &field, const SampleLanes &samples, std::size_t count,
                     const PairedPose &T, const Vector3d &centre_mm, double reach_mm) noexcept {
  std::array<float, 3> centre{};
  Eigen::Vector3f::Map(centre.data()) = centre_mm.cast<float>();
  PlaneSums sums;
  kernel().sums(query(field, samples, count, T), centre, static_cast<float>(reach_mm * reach_mm), sums);
  PlaneStep out;
  for (Eigen::Index a = 0, k = 0; a < 6; ++a) {
    for (Eigen::Index b = 0; b <= a; ++b, ++k) {
      out.normal(a, b) = out.normal(b, a) = static_cast<double>(sums.normal[static_cast<std::size_t>(k)]);
    }
    out.gradient[a] = static_cast<double>(sums.gradient[static_cast<std::size_t>(a)]);
  }
  out.cost = static_cast<double>(sums.cost);
  return out;
}

double plane_cost(const surface::SurfaceField &field, const SampleLanes &samples, std::size_t count,
                  const PairedPose &T, double reach_mm) noexcept {
  return static_cast<double>(kernel().cost(query(field, samples, count, T), static_cast<float>(reach_mm * reach_mm)));
}

double plane_median_mm(const surface::SurfaceField &field, const SampleLanes &samples, std::size_t count,
                       const PairedPose &T, float *scratch) noexcept {
  kernel().residuals(query(field, samples, count, T), scratch);
  return static_cast<double>(kernel().ranked(scratch, count, count / 2));
}

Vector6d solve_damped(const Matrix6d &normal, const Vector6d &gradient, double damping, double limit_mm) noexcept {
  const double weight = normal.bottomRightCorner<3, 3>().trace(); // the normals are unit vectors
  Vector6d diagonal;
  diagonal << Vector3d::Constant(damping * weight * kHeadLever_mm * kHeadLever_mm),
      Vector3d::Constant(damping * weight);
  Matrix6d damped = normal;
  damped.diagonal() += diagonal;
  const Eigen::LLT<Matrix6d> factor(damped);
  if (factor.info() != Eigen::Success) {
    return Vector6d::Zero();
  }
  Vector6d step = -factor.solve(gradient);
  const double motion = motion_at_lever_mm(step);
  if (!(motion <= limit_mm)) {
    step *= motion > 0.0 ? limit_mm / motion : 0.0;
  }
  return step.allFinite() ? step : Vector6d::Zero();
}

} // namespace bregma::registration
