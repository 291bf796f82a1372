// Spins near a strong local field, deposited forwards (Acquisition::added).
#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/LU>

#include "drivers/sim/scanner/acquisition.hpp"
#include "drivers/sim/scanner/flat_index.hpp"
#include "drivers/sim/scanner/point_spread.hpp"

namespace bregma::sim::scanner {

namespace {

using Complex = std::complex<float>;

// Dense samples of the slices that spins reach; others stay empty.
class DenseSlices {
public:
  DenseSlices(const image::Grid<3> &grid, const Protocol &protocol)
      : T_index_image_(grid.T_image_index.inverse()), columns_(grid.size[0]), rows_(grid.size[1]),
        wide_(detail::kDense * columns_ + 2 * detail::kMargin), high_(detail::kDense * rows_ + 2 * detail::kMargin),
        sample_mm3_(protocol.pixel_mm() * protocol.pixel_mm() * protocol.thickness_mm /
                    (detail::kDense * detail::kDense)),
        slices_(static_cast<std::size_t>(grid.size[2])) {}

  void deposit(const Vector3d &believed_mm, double volume_mm3, Complex signal) {
    const Vector3d index = T_index_image_.topLeftCorner<3, 3>() * believed_mm + T_index_image_.topRightCorner<3, 1>();
    const double x = detail::kDense * index.x() + detail::kMargin;
    const double y = detail::kDense * index.y() + detail::kMargin;
    if (x < 0.0 || y < 0.0 || x >= wide_ - 1.0 || y >= high_ - 1.0) {
      return;
    }
    const int i = static_cast<int>(x);
    const int j = static_cast<int>(y);
    const auto fx = static_cast<float>(x - i);
    const auto fy = static_cast<float>(y - j);
    const int first = std::max(0, static_cast<int>(std::ceil(index.z() - 0.6)));
    const int last = std::min(static_cast<int>(slices_.size()) - 1, static_cast<int>(std::floor(index.z() + 0.6)));
    for (int s = first; s <= last; ++s) {
      std::vector<Complex> &slice = slices_[static_cast<std::size_t>(s)];
      if (slice.empty()) {
        slice.assign(static_cast<std::size_t>(wide_) * static_cast<std::size_t>(high_), Complex{});
      }
      const Complex part = signal * static_cast<float>(volume_mm3 / sample_mm3_ * detail::slice_profile(index.z() - s));
      Complex *at = &slice[detail::flat(i, j, 0, wide_, 1)];
      at[0] += (1.0F - fx) * (1.0F - fy) * part;
      at[1] += fx * (1.0F - fy) * part;
      at[wide_] += (1.0F - fx) * fy * part;
      at[wide_ + 1] += fx * fy * part;
    }
  }

  void spread_into(image::Image<Complex, 3> &out) const {
    std::vector<Complex> scratch;
    for (std::size_t s = 0; s < slices_.size(); ++s) {
      if (!slices_[s].empty()) {
        detail::spread(slices_[s], columns_, rows_, &out.voxels[out.offset(0, 0, static_cast<int>(s))], scratch);
      }
    }
  }

private:
  Eigen::Matrix4d T_index_image_;
  int columns_, rows_, wide_, high_;
  double sample_mm3_;
  std::vector<std::vector<Complex>> slices_;
};

double sinc(double x) { return std::abs(x) < 1e-6 ? 1.0 : std::sin(std::numbers::pi * x) / (std::numbers::pi * x); }

// 1 near the centre, 0 at the reach, so that displaced spins leave neither a gap nor a crowd at the border.
double taper(double distance_mm, double reach_mm) {
  const double x = std::clamp((reach_mm - distance_mm) / 4.0, 0.0, 1.0);
  return x * x * (3.0 - 2.0 * x);
}

} // namespace

image::Image<Complex, 3> Acquisition::added(const Body &body, const BodyPose &T_device_body,
                                            const LocalField &local) const {
  image::Image<Complex, 3> out;
  static_cast<image::Grid<3> &>(out) = grid();
  out.voxels.assign(out.pixels(), Complex{});
  DenseSlices slices(out, protocol_);
  const auto T_body_device = T_device_body.inverse();
  const double h = local.step_mm;
  const int half = static_cast<int>(std::ceil(local.reach_mm / h)) + 1;
  const int side = 2 * half + 1;
  std::vector<float> hertz(static_cast<std::size_t>(side) * static_cast<std::size_t>(side) *
                           static_cast<std::size_t>(side));
  const auto place = [side](int i, int j, int k) { return detail::flat(i, j, k, side, side); };
  for (std::size_t c = 0; c < local.centres_mm.size(); ++c) {
    const Vector3d centre = h * (local.centres_mm[c] / h).array().round(); // all spins on one lattice
    const auto spin = [&](int i, int j, int k) -> Vector3d {
      return centre + h * Vector3d(i - half, j - half, k - half);
    };
    for (int k = 0; k < side; ++k) {
      for (int j = 0; j < side; ++j) {
        for (int i = 0; i < side; ++i) {
          hertz[place(i, j, k)] = static_cast<float>(local.frequency_Hz(spin(i, j, k)));
        }
      }
    }
    for (int k = 1; k + 1 < side; ++k) {
      for (int j = 1; j + 1 < side; ++j) {
        for (int i = 1; i + 1 < side; ++i) {
          const Vector3d r = spin(i, j, k);
          const double distance = (r - local.centres_mm[c]).norm();
          // A spin within reach of several centres belongs to the first of them.
          const bool taken = std::any_of(local.centres_mm.begin(), local.centres_mm.begin() + static_cast<long>(c),
                                         [&](const Vector3d &o) { return (r - o).norm() < local.reach_mm; });
          if (distance >= local.reach_mm || taken) {
            continue;
          }
          const double water = body.water(T_body_device * r, h);
          if (water <= 0.0) {
            continue;
          }
          const double volume = h * h * h;
          const Vector3d still = believed_mm(r);
          slices.deposit(still, volume, Complex(static_cast<float>(-water), 0.0F));
          if (local.is_empty && local.is_empty(r)) {
            continue;
          }
          // Phase at the echo, and what its spread within the spin's own cell cancels.
          const double f = static_cast<double>(hertz[place(i, j, k)]);
          const double te = protocol_.echo_ms * 1e-3;
          const auto turns = [&](std::size_t a, std::size_t b) {
            return 0.5 * te * static_cast<double>(hertz[a] - hertz[b]);
          };
          const double left = sinc(turns(place(i + 1, j, k), place(i - 1, j, k))) *
                              sinc(turns(place(i, j + 1, k), place(i, j - 1, k))) *
                              sinc(turns(place(i, j, k + 1), place(i, j, k - 1)));
          slices.deposit(still + f * taper(distance, local.reach_mm) * per_Hz_mm_, volume,
                         std::polar(1.0F, static_cast<float>(2.0 * std::numbers::pi * std::fmod(f * te, 1.0))) *
                             static_cast<float>(water * left));
        }
      }
    }
  }
  slices.spread_into(out);
  return out;
}

} // namespace bregma::sim::scanner
