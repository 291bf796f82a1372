#include "algorithms/mri/correction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <type_traits>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace bregma::mri {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

template <class Pixel> float bilinear(std::span<const Pixel> slice, int columns, std::size_t at, float u, float v) {
  const Pixel *p = slice.data() + at;
  const auto a = static_cast<float>(p[0]), b = static_cast<float>(p[1]);
  const auto c = static_cast<float>(p[columns]), d = static_cast<float>(p[columns + 1]);
  const float top = a + u * (b - a), bottom = c + u * (d - c);
  return top + v * (bottom - top);
}

template <class Pixel> Pixel as_pixel(float value) {
  if constexpr (std::is_integral_v<Pixel>) {
    return static_cast<Pixel>(std::clamp(value + 0.5F, 0.0F, static_cast<float>(std::numeric_limits<Pixel>::max())));
  } else {
    return value;
  }
}

} // namespace

PlaneCorrection::PlaneCorrection(const FieldTable &field, const PlaneGeometry &geometry, bool jacobian)
    : columns_(geometry.columns), rows_(geometry.rows) {
  if (columns_ < 2 || rows_ < 2 || !(std::abs(geometry.T_field_index.determinant()) > 0.0)) {
    throw std::invalid_argument("a plane needs two columns, two rows and three independent axes");
  }
  const Matrix3d axes = geometry.T_field_index.topLeftCorner<3, 3>();
  const Matrix3d to_index = axes.inverse();
  const Vector3d origin = geometry.T_field_index.topRightCorner<3, 1>();
  const Vector3d normal = axes.col(0).cross(axes.col(1)).normalized();
  const auto count = static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  sources_.reserve(count);
  std::size_t extrapolated = 0, unknown = 0;
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const Vector3d p = origin + axes * Vector3d(column, row, 0.0);
      const FieldTable::Sample sample = field.sample(p);
      const Vector3d shift = to_index * sample.displacement_mm;
      const double factor = jacobian ? field.volume_ratio(p) : 1.0;
      sources_.push_back({static_cast<float>(column + shift.x()), static_cast<float>(row + shift.y()),
                          static_cast<float>(shift.z()), static_cast<float>(factor)});
      if (sample.coverage == Coverage::kUnknown) {
        ++unknown;
        continue;
      }
      extrapolated += sample.coverage == Coverage::kExtrapolates ? 1 : 0;
      summary_.max_shift_mm = std::max(summary_.max_shift_mm, sample.displacement_mm.norm());
      summary_.max_through_plane_mm =
          std::max(summary_.max_through_plane_mm, std::abs(sample.displacement_mm.dot(normal)));
      summary_.error_95_mm = std::max(summary_.error_95_mm, sample.error_95_mm);
    }
  }
  const auto total = static_cast<double>(std::max<std::size_t>(count, 1));
  summary_.extrapolated_fraction = static_cast<double>(extrapolated) / total;
  summary_.unknown_fraction = static_cast<double>(unknown) / total;
}

double PlaneCorrection::missing_fraction(int slices, int index) const {
  const auto missing = std::count_if(sources_.begin(), sources_.end(), [&](const Source &s) {
    const float at = static_cast<float>(index) + s.slice;
    return at < -0.5F || at > static_cast<float>(slices) - 0.5F;
  });
  return static_cast<double>(missing) / static_cast<double>(std::max<std::size_t>(sources_.size(), 1));
}

template <class Pixel>
void PlaneCorrection::apply(std::span<const std::span<const Pixel>> slices, int index, std::span<Pixel> out) const {
  const auto last_column = static_cast<float>(columns_ - 1), last_row = static_cast<float>(rows_ - 1);
  const auto last_slice = static_cast<float>(static_cast<int>(slices.size()) - 1);
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    const Source &s = sources_[i];
    // Half a pixel beyond the outermost centres still belongs to the image.
    if (!(s.column > -0.5F && s.row > -0.5F && s.column < last_column + 0.5F && s.row < last_row + 0.5F)) {
      out[i] = Pixel{0};
      continue;
    }
    const float x = std::clamp(s.column, 0.0F, last_column), y = std::clamp(s.row, 0.0F, last_row);
    const int column = std::min(static_cast<int>(x), columns_ - 2), row = std::min(static_cast<int>(y), rows_ - 2);
    const float u = x - static_cast<float>(column), v = y - static_cast<float>(row);
    const auto at =
        static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
    const float z = std::clamp(static_cast<float>(index) + s.slice, 0.0F, last_slice);
    const auto below = static_cast<std::size_t>(z);
    const float w = z - static_cast<float>(below);
    float value = bilinear(slices[below], columns_, at, u, v);
    if (w > 0.0F) {
      value += w * (bilinear(slices[below + 1], columns_, at, u, v) - value);
    }
    out[i] = as_pixel<Pixel>(value * s.factor);
  }
}

template void PlaneCorrection::apply(std::span<const std::span<const std::uint16_t>>, int,
                                     std::span<std::uint16_t>) const;
template void PlaneCorrection::apply(std::span<const std::span<const float>>, int, std::span<float>) const;

} // namespace bregma::mri
