#include "algorithms/mri/solid_harmonics.hpp"

#include <cmath>
#include <cstddef>

namespace bregma::mri {

namespace {

constexpr std::size_t kSide = kMaxHarmonicDegree + 1;
using Table = std::array<std::array<double, kSide>, kSide>; // by degree, then order

// sqrt(2 (n - m)! / (n + m)!), without the 2 for m = 0.
Table schmidt_factors() {
  Table out{};
  for (std::size_t n = 0; n < kSide; ++n) {
    double ratio = 1.0; // (n - m)! / (n + m)!
    for (std::size_t m = 0; m <= n; ++m) {
      if (m > 0) {
        ratio /= static_cast<double>((n + m) * (n - m + 1));
      }
      out.at(n).at(m) = std::sqrt(m > 0 ? 2.0 * ratio : ratio);
    }
  }
  return out;
}

const Table &factors() {
  static const Table table = schmidt_factors();
  return table;
}

} // namespace

void solid_harmonics(int degree, const Eigen::Vector3d &point, std::span<double> out) noexcept {
  const Table &factor = factors();
  const double x = point.x(), y = point.y(), z = point.z(), r2 = point.squaredNorm();
  const auto top = static_cast<std::size_t>(degree);
  double cosine = 1.0, sine = 0.0; // (x + i y)^m
  double diagonal = 1.0;           // (2 m - 1)!!, the polynomial in z and r of degree m
  for (std::size_t m = 0; m <= top; ++m) {
    double before = 0.0, current = diagonal;
    for (std::size_t n = m; n <= top; ++n) {
      if (n > m) {
        // (n - m) P_n = (2 n - 1) z P_(n-1) - (n + m - 1) r^2 P_(n-2)
        const double next =
            (static_cast<double>(2 * n - 1) * z * current - static_cast<double>(n + m - 1) * r2 * before) /
            static_cast<double>(n - m);
        before = current;
        current = next;
      }
      const double scaled = factor[n][m] * current;
      const std::size_t begin = n * n;
      if (m == 0) {
        out[begin] = scaled;
      } else {
        out[begin + 2 * m - 1] = scaled * cosine;
        out[begin + 2 * m] = scaled * sine;
      }
    }
    const double turned = cosine * x - sine * y;
    sine = cosine * y + sine * x;
    cosine = turned;
    diagonal *= static_cast<double>(2 * m + 1);
  }
}

Eigen::MatrixXd harmonic_matrix(const geometry::Points3 &points_mm, int degree, double radius_mm) {
  Eigen::MatrixXd out(harmonic_count(degree), points_mm.cols());
  for (Eigen::Index i = 0; i < points_mm.cols(); ++i) {
    solid_harmonics(degree, points_mm.col(i) / radius_mm,
                    std::span<double>(out.col(i).data(), static_cast<std::size_t>(out.rows())));
  }
  return out;
}

} // namespace bregma::mri
