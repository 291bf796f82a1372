#include "drivers/sim/scanner/loop_field.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/sim/scanner/flat_index.hpp"

namespace bregma::sim::scanner {

namespace {

constexpr double kStep_mm = 0.25; // of the table; spins are no denser
constexpr double kMu0 = 4e-7 * M_PI;

} // namespace

LoopField loop_field(double radius_mm, double current_A, double radial_mm, double along_mm) {
  const double a = radius_mm * 1e-3;
  const double r = radial_mm * 1e-3;
  const double z = along_mm * 1e-3;
  const double near = (a - r) * (a - r) + z * z;
  const double far = (a + r) * (a + r) + z * z;
  const double k = std::sqrt(std::max(0.0, 1.0 - near / far));
  const double K = std::comp_ellint_1(k);
  const double E = std::comp_ellint_2(k);
  const double scale = kMu0 * current_A / (2.0 * M_PI * std::sqrt(far));
  LoopField out;
  out.along_T = scale * (K + (a * a - r * r - z * z) / near * E);
  // On the axis the radial part vanishes, and its closed form is 0 / 0.
  out.radial_T = r < 1e-9 ? 0.0 : scale * z / r * (-K + (a * a + r * r + z * z) / near * E);
  return out;
}

CoilField::CoilField(const CoilShape &shape, double reach_mm)
    : reach_mm_(reach_mm), nodes_(static_cast<int>(std::ceil(reach_mm / kStep_mm)) + 2),
      table_(static_cast<std::size_t>(nodes_) * static_cast<std::size_t>(nodes_), Eigen::Vector2f::Zero()) {
  const int rings = std::max(1, shape.turns);
  for (int iz = 0; iz < nodes_; ++iz) {
    for (int ir = 0; ir < nodes_; ++ir) {
      LoopField sum;
      for (int n = 0; n < rings; ++n) {
        const double offset = rings == 1 ? 0.0 : shape.length_mm * (static_cast<double>(n) / (rings - 1) - 0.5);
        // Inside the wire itself the field of a thin loop grows without limit: stay a wire's radius away.
        double radial = ir * kStep_mm;
        if (std::hypot(radial - shape.radius_mm, iz * kStep_mm - offset) < 0.125) {
          radial = shape.radius_mm - 0.125;
        }
        const LoopField one = loop_field(shape.radius_mm, 1.0, radial, iz * kStep_mm - offset);
        sum.along_T += one.along_T;
        sum.radial_T += one.radial_T;
      }
      table_[detail::flat(ir, iz, 0, nodes_, 1)] = Eigen::Vector2d(sum.along_T, sum.radial_T).cast<float>();
    }
  }
}

Eigen::Vector3d CoilField::operator()(const Eigen::Vector3d &from_centre_mm, const Eigen::Vector3d &axis) const {
  const double along = from_centre_mm.dot(axis);
  const Eigen::Vector3d across = from_centre_mm - along * axis;
  const double radial = across.norm();
  const double u = radial / kStep_mm;
  const double v = std::abs(along) / kStep_mm;
  if (radial >= reach_mm_ || std::abs(along) >= reach_mm_) {
    return Eigen::Vector3d::Zero();
  }
  const int i = static_cast<int>(u);
  const int j = static_cast<int>(v);
  const auto fu = static_cast<float>(u - i);
  const auto fv = static_cast<float>(v - j);
  const Eigen::Vector2f *row = &table_[detail::flat(i, j, 0, nodes_, 1)];
  const Eigen::Vector2f field =
      (1.0F - fv) * ((1.0F - fu) * row[0] + fu * row[1]) + fv * ((1.0F - fu) * row[nodes_] + fu * row[nodes_ + 1]);
  Eigen::Vector3d out = static_cast<double>(field[0]) * axis;
  if (radial > 1e-9) { // odd in z
    out += (along < 0.0 ? -1.0 : 1.0) * static_cast<double>(field[1]) / radial * across;
  }
  return out;
}

} // namespace bregma::sim::scanner
