// From the noiseless image to what arrives: movement, shading, noise, and the vendor's correction.
#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "drivers/sim/scanner/acquisition.hpp"
#include "drivers/sim/scanner/flat_index.hpp"

namespace bregma::sim::scanner {

namespace {

// Sensitivity of the receiver coils, about 1.
class Shading {
public:
  Shading(double size, std::uint64_t seed) : size_(size) {
    Random random(seed, "shading");
    for (double &weight : weights_) {
      weight = random.normal(1.0);
    }
  }
  [[nodiscard]] double operator()(const Vector3d &r_mm) const {
    const Vector3d u = r_mm / 120.0;
    const double sum = weights_[0] * u.x() + weights_[1] * u.y() + weights_[2] * u.z() +
                       0.5 * (weights_[3] * u.x() * u.x() + weights_[4] * u.y() * u.y() + weights_[5] * u.z() * u.z() +
                              weights_[6] * u.x() * u.y() + weights_[7] * u.y() * u.z() + weights_[8] * u.x() * u.z());
    return std::exp(0.5 * size_ * std::clamp(sum, -4.0, 4.0));
  }

private:
  double size_;
  std::array<double, 9> weights_{};
};

float sample(const Stack &image, const Vector3d &index) {
  std::array<int, 3> cell{};
  Vector3d f;
  for (int d = 0; d < 3; ++d) {
    const auto D = static_cast<std::size_t>(d);
    const double x = std::clamp(index[d], 0.0, image.size[D] - 1.001);
    cell[D] = static_cast<int>(x);
    f[d] = x - cell[D];
  }
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const int a = corner & 1, b = (corner >> 1) & 1, c = (corner >> 2) & 1;
    sum += (a != 0 ? f.x() : 1.0 - f.x()) * (b != 0 ? f.y() : 1.0 - f.y()) * (c != 0 ? f.z() : 1.0 - f.z()) *
           static_cast<double>(image.at(cell[0] + a, cell[1] + b, std::min(cell[2] + c, image.size[2] - 1)));
  }
  return static_cast<float>(sum);
}

} // namespace

Stack received(const Stack &clean, const image::Image<std::complex<float>, 3> *added, const Vector3d &shift_mm,
               const Appearance &appearance, std::uint64_t shading_seed, Random &noise) {
  Stack out = clean;
  const Shading shading(appearance.shading, shading_seed);
  const Vector3d shift = clean.axes().inverse() * shift_mm; // in pixels
  const double sigma = appearance.snr > 0.0 ? appearance.water / appearance.snr : 0.0;
  for (int k = 0; k < out.size[2]; ++k) {
    for (int j = 0; j < out.size[1]; ++j) {
      for (int i = 0; i < out.size[0]; ++i) {
        const std::size_t at = out.offset(i, j, k);
        // First order in a movement far below a pixel.
        const auto slope = [&](int di, int dj, int dk) {
          const int i0 = std::max(i - di, 0), i1 = std::min(i + di, out.size[0] - 1);
          const int j0 = std::max(j - dj, 0), j1 = std::min(j + dj, out.size[1] - 1);
          const int k0 = std::max(k - dk, 0), k1 = std::min(k + dk, out.size[2] - 1);
          const int steps = std::max({i1 - i0, j1 - j0, k1 - k0, 1});
          return static_cast<double>(clean.at(i1, j1, k1) - clean.at(i0, j0, k0)) / steps;
        };
        std::complex<double> signal = static_cast<double>(clean.voxels[at]);
        if (!shift.isZero()) {
          signal -= shift.x() * slope(1, 0, 0) + shift.y() * slope(0, 1, 0) + shift.z() * slope(0, 0, 1);
        }
        if (added != nullptr) {
          signal += std::complex<double>(added->voxels[at]);
        }
        signal *= appearance.water * shading(out.point_mm(Vector3d(i, j, k)));
        if (sigma > 0.0) {
          signal += std::complex<double>(noise.normal(sigma), noise.normal(sigma));
        }
        out.voxels[at] = static_cast<float>(std::abs(signal));
      }
    }
  }
  return out;
}

Stack vendor_corrected(const Stack &acquired, const ScannerField &field) {
  Stack out = acquired;
  const Eigen::Matrix4d T_index_image = acquired.T_image_index.inverse();
  const double voxel = acquired.axes().determinant();
  const int columns = out.size[0], rows = out.size[1];
  // Where the scanner believed a slice to be, with one more row and column; the change of volume is that of its cells.
  const auto believed_slice = [&](int k) {
    std::vector<Vector3d> all;
    for (int j = 0; j <= rows; ++j) {
      for (int i = 0; i <= columns; ++i) {
        const Vector3d r = out.point_mm(Vector3d(i, j, k));
        all.push_back(r + field.gradient_mm(r));
      }
    }
    return all;
  };
  std::vector<Vector3d> here = believed_slice(0);
  std::size_t at = 0;
  for (int k = 0; k < out.size[2]; ++k) {
    std::vector<Vector3d> next = believed_slice(k + 1);
    for (int j = 0; j < rows; ++j) {
      for (int i = 0; i < columns; ++i, ++at) {
        const auto n = detail::flat(i, j, 0, columns + 1, 1);
        Eigen::Matrix3d cell;
        cell << here[n + 1] - here[n], here[n + static_cast<std::size_t>(columns) + 1] - here[n], next[n] - here[n];
        out.voxels[at] =
            static_cast<float>(cell.determinant() / voxel) *
            sample(acquired, T_index_image.topLeftCorner<3, 3>() * here[n] + T_index_image.topRightCorner<3, 1>());
      }
    }
    here = std::move(next);
  }
  return out;
}

} // namespace bregma::sim::scanner
