#include "server/stages/scanner/slice_stack.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/mri/separation.hpp"
#include "server/stages/scanner/slice_guard.hpp"

namespace bregma::server {

namespace {

constexpr double kSamePlace_mm = 0.05;

} // namespace

Eigen::Vector3d movement_by_b0(const wire::ImageSlice &slice) {
  const bool along_row =
      slice.read_out == bregma_wire_DIRECTION_ROW_POSITIVE || slice.read_out == bregma_wire_DIRECTION_ROW_NEGATIVE;
  if (slice.read_out == bregma_wire_DIRECTION_UNKNOWN || !(slice.bandwidth_Hz_per_pixel > 0.0)) {
    return Eigen::Vector3d::Zero();
  }
  const bool reversed =
      slice.read_out == bregma_wire_DIRECTION_ROW_NEGATIVE || slice.read_out == bregma_wire_DIRECTION_COLUMN_NEGATIVE;
  const Eigen::Vector3d axis = axes_of(slice).col(along_row ? 0 : 1);
  return mri::b0_movement((reversed ? -1.0 : 1.0) * axis, slice.spacing_mm[along_row ? 0 : 1],
                          slice.bandwidth_Hz_per_pixel);
}

SliceStack::SliceStack(const wire::ImageSlice &first)
    : series_(first.series), size_{static_cast<int>(first.columns), static_cast<int>(first.rows),
                                   static_cast<int>(first.count)},
      axes_(axes_of(first)), spacing_mm_(first.spacing_mm[0], first.spacing_mm[1]),
      thickness_mm_(first.thickness_mm > 0.0 ? first.thickness_mm : 1.0), slices_(first.count),
      origins_mm_(first.count, Eigen::Vector3d::Zero()) {
  (void)add(first); // the first belongs to itself
}

tl::expected<void, std::string> SliceStack::add(const wire::ImageSlice &slice) {
  if (slice.series != series_ || slice.count != slices_.size() || slice.index == 0 || slice.index > slices_.size() ||
      static_cast<int>(slice.columns) != size_[0] || static_cast<int>(slice.rows) != size_[1]) {
    return tl::make_unexpected("it does not belong to the series: another size or number of slices");
  }
  if (!slices_[slice.index - 1].empty()) {
    return tl::make_unexpected("it was received already");
  }
  if ((axes_of(slice) - axes_).cwiseAbs().maxCoeff() > kSameDirection ||
      (Eigen::Vector2d::Map(slice.spacing_mm) - spacing_mm_).cwiseAbs().maxCoeff() > 1e-6) {
    return tl::make_unexpected("mixed orientations or spacings");
  }
  const std::uint16_t *pixels = slice.pixels._buffer;
  slices_[slice.index - 1].assign(pixels, pixels + slice.pixels._length);
  origins_mm_[slice.index - 1] = Eigen::Vector3d::Map(slice.T_scanner_slice.translation_mm);
  ++received_;
  return {};
}

tl::expected<image::Image<float, 3>, std::string> SliceStack::stack() const {
  if (!complete()) {
    return tl::make_unexpected(std::to_string(received_) + " of " + std::to_string(expected()) + " slices came");
  }
  const int count = size_[2];
  const Eigen::Vector3d step = count > 1 ? Eigen::Vector3d((origins_mm_.back() - origins_mm_.front()) / (count - 1))
                                         : Eigen::Vector3d(thickness_mm_ * axes_.col(2));
  if (std::abs(step.dot(axes_.col(2))) < 0.1 * kSamePlace_mm) {
    return tl::make_unexpected("its slices lie in one plane");
  }
  image::Image<float, 3> out;
  out.size = size_;
  out.T_image_index.topLeftCorner<3, 3>() << axes_.col(0) * spacing_mm_[0], axes_.col(1) * spacing_mm_[1], step;
  out.T_image_index.topRightCorner<3, 1>() = origins_mm_.front();
  out.voxels.reserve(out.pixels());
  for (int k = 0; k < count; ++k) {
    const auto at = static_cast<std::size_t>(k);
    if ((origins_mm_[at] - (origins_mm_.front() + k * step)).norm() > kSamePlace_mm) {
      return tl::make_unexpected("its slices are not at equal steps: slice " + std::to_string(k + 1));
    }
    out.voxels.insert(out.voxels.end(), slices_[at].begin(), slices_[at].end());
  }
  return out;
}

} // namespace bregma::server
