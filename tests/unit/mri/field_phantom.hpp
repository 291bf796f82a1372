// Distortions and phantoms for tests that share no formula with the estimators: potentials of point sources outside
// the bore, which are harmonic inside but no polynomials, and a bump that is not harmonic.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Core>

#include "algorithms/geometry/points.hpp"

namespace bregma::test {

class SourceField {
public:
  // Displacements of about `size_mm` at 100 mm from the isocentre.
  explicit SourceField(unsigned seed, double size_mm = 2.0) {
    std::mt19937 rng(seed);
    std::normal_distribution<double> gauss;
    std::uniform_real_distribution<double> far(320.0, 450.0);
    for (int i = 0; i < 24; ++i) {
      const Eigen::Vector3d side(gauss(rng), gauss(rng), gauss(rng));
      sources_.push_back(far(rng) * side.normalized());
      strengths_.emplace_back(gauss(rng), gauss(rng), gauss(rng));
    }
    double sum = 0.0;
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d side(gauss(rng), gauss(rng), gauss(rng));
      sum += displacement(100.0 * side.normalized()).squaredNorm();
    }
    for (auto &s : strengths_) {
      s *= size_mm / std::sqrt(sum / 200.0);
    }
  }

  double bump_mm = 0.0; // height of a displacement along y around (30, 20, 0), 25 mm wide

  [[nodiscard]] Eigen::Vector3d displacement(const Eigen::Vector3d &p) const {
    Eigen::Vector3d out = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      const double r = sources_[i].norm();
      // Without the constant and the slope, which a rigid alignment would take away.
      out += strengths_[i] * (r / (p - sources_[i]).norm() - 1.0 - p.dot(sources_[i]) / (r * r));
    }
    out.y() += bump_mm * std::exp(-0.5 * (p - Eigen::Vector3d(30.0, 20.0, 0.0)).squaredNorm() / (25.0 * 25.0));
    return out;
  }
  [[nodiscard]] Eigen::Vector3d image_of(const Eigen::Vector3d &p) const { return p + displacement(p); }
  [[nodiscard]] geometry::Points3 image_of(const geometry::Points3 &p) const {
    geometry::Points3 out(3, p.cols());
    for (Eigen::Index i = 0; i < p.cols(); ++i) {
      out.col(i) = image_of(Eigen::Vector3d(p.col(i)));
    }
    return out;
  }

private:
  std::vector<Eigen::Vector3d> sources_, strengths_;
};

// n^3 points, `step` apart, around `centre`.
inline geometry::Points3 lattice(int n, double step, const Eigen::Vector3d &centre = Eigen::Vector3d::Zero()) {
  geometry::Points3 out(3, static_cast<Eigen::Index>(n) * n * n);
  Eigen::Index column = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      for (int k = 0; k < n; ++k) {
        out.col(column++) = centre + step * (Eigen::Vector3d(k, j, i) - Eigen::Vector3d::Constant(0.5 * (n - 1)));
      }
    }
  }
  return out;
}

inline geometry::Points3 with_noise(geometry::Points3 p, double sigma_mm, unsigned seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> gauss(0.0, sigma_mm);
  for (auto &x : p.reshaped()) {
    x += gauss(rng);
  }
  return p;
}

} // namespace bregma::test
