#include "drivers/sim/scanner/scanner_field.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "drivers/sim/random.hpp"
#include "drivers/sim/scanner/flat_index.hpp"

namespace bregma::sim::scanner {

namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr int kFirstOrder = 2, kLastOrder = 7;
constexpr double kRadius_mm = 150.0; // at which the coefficients are sizes in mm

// One field as a function of place, before it is tabulated.
struct Bump {
  Vector3d centre_mm;
  double width_mm;
};

// A basis of displacements: the low part (slowly varying) and the high part are blended to reach mean and maximum.
class Basis {
public:
  Basis(FieldKind kind, Random &random) : kind_(kind) {
    for (int n = 0; n < 24; ++n) {
      bumps_.push_back({Vector3d(random.uniform(-130, 130), random.uniform(-130, 130), random.uniform(-130, 130)),
                        n < 12 ? 120.0 : 60.0});
    }
    low_ = Eigen::Matrix3Xd::Zero(3, size());
    high_ = low_;
    for (int n = 0; n < size(); ++n) {
      const Vector3d value = random.normal3(1.0);
      (is_low(n) ? low_ : high_).col(n) = value;
    }
  }

  void scale(double low, double high) {
    low_ *= low;
    high_ *= high;
  }
  [[nodiscard]] Vector3d low(const Vector3d &r) const { return low_ * values(r); }
  [[nodiscard]] Vector3d high(const Vector3d &r) const { return high_ * values(r); }
  [[nodiscard]] Vector3d both(const Vector3d &r) const { return (low_ + high_) * values(r); }

private:
  [[nodiscard]] int size() const {
    return kind_ == FieldKind::kBumps ? static_cast<int>(bumps_.size())
                                      : (kLastOrder + 1) * (kLastOrder + 1) - kFirstOrder * kFirstOrder;
  }
  [[nodiscard]] bool is_low(int n) const {
    return kind_ == FieldKind::kBumps ? n < 12 : n < 4 * 4 - kFirstOrder * kFirstOrder; // orders 2 and 3
  }
  [[nodiscard]] Eigen::VectorXd values(const Vector3d &r) const {
    if (kind_ == FieldKind::kBumps) {
      Eigen::VectorXd out(size());
      for (int n = 0; n < size(); ++n) {
        const Bump &b = bumps_[static_cast<std::size_t>(n)];
        out[n] = std::exp(-0.5 * (r - b.centre_mm).squaredNorm() / (b.width_mm * b.width_mm));
      }
      return out;
    }
    const std::vector<double> h = solid_harmonics(r, kRadius_mm, kFirstOrder, kLastOrder);
    return Eigen::Map<const Eigen::VectorXd>(h.data(), static_cast<Eigen::Index>(h.size()));
  }

  FieldKind kind_;
  std::vector<Bump> bumps_;
  Matrix3Xd low_, high_;
};

// What is left of displacements after the small rigid motion that fits them best.
Matrix3Xd without_rigid(std::span<const Vector3d> at, const Matrix3Xd &d) {
  const auto n = static_cast<Eigen::Index>(at.size());
  Eigen::MatrixXd J(3 * n, 6);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vector3d &p = at[static_cast<std::size_t>(i)];
    J.block<3, 6>(3 * i, 0) << 0, p.z(), -p.y(), 1, 0, 0, -p.z(), 0, p.x(), 0, 1, 0, p.y(), -p.x(), 0, 0, 0, 1;
  }
  const Eigen::VectorXd b = Eigen::Map<const Eigen::VectorXd>(d.data(), 3 * n);
  const Eigen::VectorXd left = b - J * (J.transpose() * J).completeOrthogonalDecomposition().solve(J.transpose() * b);
  return Eigen::Map<const Matrix3Xd>(left.data(), 3, n);
}

ScannerField::Distortion sizes(const Matrix3Xd &d) {
  const Eigen::RowVectorXd norms = d.colwise().norm();
  return {norms.mean(), norms.maxCoeff()};
}

// Scales the basis so that the sample's mean is met, and the maximum as nearly as a blend of low and high can.
void fit_sizes(Basis &basis, const FieldOptions &options, std::span<const Vector3d> sample) {
  const auto n = static_cast<Eigen::Index>(sample.size());
  Matrix3Xd low(3, n), high(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    low.col(i) = basis.low(sample[static_cast<std::size_t>(i)]);
    high.col(i) = basis.high(sample[static_cast<std::size_t>(i)]);
  }
  low = without_rigid(sample, low);
  high = without_rigid(sample, high);
  const double low_mean = std::max(1e-9, sizes(low).mean_mm);
  const double high_mean = std::max(1e-9, sizes(high).mean_mm);
  double best = 1e300, low_scale = 0.0, high_scale = 0.0;
  for (int step = 0; step <= 40; ++step) {
    const double part = step / 40.0;
    const double a = (1.0 - part) / low_mean;
    const double b = part / high_mean;
    const ScannerField::Distortion d = sizes(a * low + b * high);
    const double miss = std::abs(d.max_mm / d.mean_mm - options.max_mm / options.mean_mm);
    if (miss < best) {
      best = miss;
      low_scale = a * options.mean_mm / d.mean_mm;
      high_scale = b * options.mean_mm / d.mean_mm;
    }
  }
  basis.scale(low_scale, high_scale);
}

} // namespace

std::vector<double> solid_harmonics(const Vector3d &r_mm, double radius_mm, int first, int last) {
  const Vector3d u = r_mm / radius_mm;
  const double r2 = u.squaredNorm();
  // Solid Legendre functions S_n^m = r^(n-m) P_n^m(cos) / sin^m by recurrence, and (x + i y)^m.
  std::vector<double> out;
  std::array<std::array<double, 16>, 16> S{};
  std::array<double, 16> re{}, im{};
  re[0] = 1.0;
  for (std::size_t m = 1; m <= static_cast<std::size_t>(last); ++m) {
    re[m] = re[m - 1] * u.x() - im[m - 1] * u.y();
    im[m] = re[m - 1] * u.y() + im[m - 1] * u.x();
  }
  for (int m = 0; m <= last; ++m) {
    const auto M = static_cast<std::size_t>(m);
    S[M][M] = 1.0; // the factor (2m - 1)!! is part of the scale that is divided out
    if (m < last) {
      S[M + 1][M] = (2.0 * m + 1.0) * u.z();
    }
    for (int n = m + 2; n <= last; ++n) {
      const auto N = static_cast<std::size_t>(n);
      S[N][M] = ((2.0 * n - 1.0) * u.z() * S[N - 1][M] - (n + m - 1.0) * r2 * S[N - 2][M]) / (n - m);
    }
  }
  for (int n = first; n <= last; ++n) {
    for (int m = 0; m <= n; ++m) {
      const auto M = static_cast<std::size_t>(m);
      // Near the largest value of sin^m S on the unit sphere: 1 for m = 0 and m = n, and in between by the ratio of the
      // normalisations of the surface harmonics.
      double scale = 1.0;
      for (int k = 1; k <= m; ++k) {
        scale *= std::sqrt(static_cast<double>(n - k + 1) * (n + k)) / (2.0 * k - 1.0);
      }
      const double value = S[static_cast<std::size_t>(n)][M] / scale;
      out.push_back(value * re[M]);
      if (m > 0) {
        out.push_back(value * im[M]);
      }
    }
  }
  return out;
}

ScannerField::ScannerField(const FieldOptions &options, std::span<const Vector3d> sample_mm, std::uint64_t seed)
    : table_(static_cast<std::size_t>(kNodes) * kNodes * kNodes, Eigen::Array4f::Zero()) {
  Random gradients(seed, "gradients");
  Random shim(seed, "b0");
  Basis basis(options.kind, gradients);
  const bool distorted = options.kind != FieldKind::kNone && options.mean_mm > 0.0;
  if (distorted) {
    fit_sizes(basis, options, sample_mm);
  }
  Eigen::VectorXd b0(5 * 5 - 1); // orders 1 to 4: what a shim leaves
  for (Eigen::Index i = 0; i < b0.size(); ++i) {
    b0[i] = shim.normal(i < 3 ? 0.3 : 1.0);
  }
  const auto b0_at = [&](const Vector3d &r) {
    const std::vector<double> h = solid_harmonics(r, kRadius_mm, 1, 4);
    return Eigen::Map<const Eigen::VectorXd>(h.data(), b0.size()).dot(b0);
  };
  double squares = 0.0;
  for (const Vector3d &p : sample_mm) {
    squares += b0_at(p) * b0_at(p);
  }
  b0 *= options.b0_Hz / std::sqrt(std::max(1e-12, squares / static_cast<double>(sample_mm.size())));

  std::size_t at = 0;
  for (int k = 0; k < kNodes; ++k) {
    for (int j = 0; j < kNodes; ++j) {
      for (int i = 0; i < kNodes; ++i, ++at) {
        const Vector3d r = Vector3d(i, j, k) * kStep_mm - Vector3d::Constant(kHalf_mm);
        // Outside a bore's radius the polynomials grow without limit; magnets end there.
        const Vector3d inside = r.norm() > 170.0 ? Vector3d(r * 170.0 / r.norm()) : r;
        const Vector3d d = distorted ? basis.both(inside) : Vector3d::Zero();
        table_[at] << d.cast<float>().array(), static_cast<float>(b0_at(inside));
      }
    }
  }
}

Eigen::Array4f ScannerField::at(const Vector3d &r_mm) const {
  std::array<int, 3> cell{};
  Eigen::Array3f f;
  for (int d = 0; d < 3; ++d) {
    const double x = std::clamp((r_mm[d] + kHalf_mm) / kStep_mm, 0.0, kNodes - 1.001);
    cell[static_cast<std::size_t>(d)] = static_cast<int>(x);
    f[d] = static_cast<float>(x - static_cast<int>(x));
  }
  const Eigen::Array4f *p = &table_[detail::flat(cell[0], cell[1], cell[2], kNodes, kNodes)];
  const auto line = [&](const Eigen::Array4f *q) -> Eigen::Array4f { return q[0] + f[0] * (q[1] - q[0]); };
  const auto face = [&](const Eigen::Array4f *q) -> Eigen::Array4f {
    const Eigen::Array4f a = line(q);
    return a + f[1] * (line(q + kNodes) - a);
  };
  const Eigen::Array4f a = face(p);
  return a + f[2] * (face(p + detail::flat(0, 0, 1, kNodes, kNodes)) - a);
}

ScannerField ScannerField::with_b0(const std::function<double(const Vector3d &)> &extra_Hz) const {
  ScannerField out = *this;
  std::size_t at = 0;
  for (int k = 0; k < kNodes; ++k) {
    for (int j = 0; j < kNodes; ++j) {
      for (int i = 0; i < kNodes; ++i, ++at) {
        out.table_[at][3] += static_cast<float>(extra_Hz(Vector3d(i, j, k) * kStep_mm - Vector3d::Constant(kHalf_mm)));
      }
    }
  }
  return out;
}

ScannerField ScannerField::without_gradients() const {
  ScannerField out = *this;
  for (Eigen::Array4f &node : out.table_) {
    node.head<3>().setZero();
  }
  return out;
}

ScannerField::Distortion ScannerField::distortion(std::span<const Vector3d> sample_mm) const {
  Matrix3Xd d(3, static_cast<Eigen::Index>(sample_mm.size()));
  for (std::size_t i = 0; i < sample_mm.size(); ++i) {
    d.col(static_cast<Eigen::Index>(i)) = gradient_mm(sample_mm[i]);
  }
  return sizes(without_rigid(sample_mm, d));
}

} // namespace bregma::sim::scanner
