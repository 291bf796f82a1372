#include "server/stages/scanner/slice_corrector.hpp"

#include <algorithm>
#include <iterator>
#include <span>
#include <utility>

#include "server/stages/scanner/coil_scans.hpp"
#include "server/stages/scanner/slice_guard.hpp"

namespace bregma::server {

namespace {

constexpr std::size_t kMaxPlanes = 16; // a megabyte each at 256 x 256
constexpr int kReach = 8;              // slices on either side: more than any through-plane distortion
constexpr double kPlane_mm = 1e-3;     // planes that differ by less are the same
constexpr double kComplete = 0.01;     // fraction of the pixels that may lack their neighbours

} // namespace

OwnedSlice::OwnedSlice(const wire::ImageSlice &slice)
    : header(slice), pixels(slice.pixels._buffer, slice.pixels._buffer + slice.pixels._length) {
  header.pixels = {};
}

wire::ImageSlice OwnedSlice::view() const {
  wire::ImageSlice out = header;
  out.pixels._buffer = const_cast<std::uint16_t *>(pixels.data()); // a sample that is written is not changed
  out.pixels._length = out.pixels._maximum = static_cast<std::uint32_t>(pixels.size());
  out.pixels._release = false;
  return out;
}

void SliceCorrector::remember(const OwnedSlice &slice) {
  if (slice.header.series != series_ || received_.size() != slice.header.count) {
    series_ = slice.header.series;
    received_.assign(slice.header.count, OwnedSlice());
  }
  received_[slice.header.index - 1] = slice;
}

const mri::PlaneCorrection &SliceCorrector::plane(const mri::PlaneGeometry &geometry) {
  const auto found = std::find_if(planes_.begin(), planes_.end(), [&](const Plane &plane) {
    return plane.geometry.columns == geometry.columns && plane.geometry.rows == geometry.rows &&
           (plane.geometry.T_field_index - geometry.T_field_index).cwiseAbs().maxCoeff() < kPlane_mm;
  });
  if (found != planes_.end()) {
    std::rotate(found, std::next(found), planes_.end());
    return *planes_.back().correction;
  }
  if (planes_.size() >= kMaxPlanes) {
    planes_.erase(planes_.begin());
  }
  planes_.push_back({geometry, std::make_unique<mri::PlaneCorrection>(*table_, geometry, jacobian_)});
  return *planes_.back().correction;
}

base::Result<CorrectedPixels> SliceCorrector::correct(const OwnedSlice &slice, const ScannerField &field) {
  const wire::ImageSlice &header = slice.header;
  if (header.correction != bregma_wire_CORRECTION_NONE) {
    return base::failure(header.correction == bregma_wire_CORRECTION_UNKNOWN
                             ? "the scanner does not state whether the slice is corrected"
                             : "the slice is corrected already");
  }
  if (!stated_position(header)) {
    return base::failure("the scanner does not state the patient position");
  }
  if (table_ != field.table) {
    table_ = field.table;
    planes_.clear();
  }
  remember(slice);
  const int k = static_cast<int>(header.index) - 1;
  const auto has = [&](int i) {
    return i >= 0 && i < static_cast<int>(received_.size()) && !received_[static_cast<std::size_t>(i)].pixels.empty();
  };
  int first = k, last = k;
  while (k - first < kReach && has(first - 1)) {
    --first;
  }
  while (last - k < kReach && has(last + 1)) {
    ++last;
  }
  const auto origin = [&](int i) {
    return Eigen::Vector3d::Map(received_[static_cast<std::size_t>(i)].header.T_scanner_slice.translation_mm);
  };
  const Eigen::Matrix3d axes = axes_of(header);
  const double thickness = header.thickness_mm > 0.0 ? header.thickness_mm : 1.0;
  Eigen::Vector3d step = thickness * axes.col(2);
  if (last > first) {
    step = (origin(last) - origin(first)) / (last - first);
  }
  Eigen::Matrix4d T_device_index = Eigen::Matrix4d::Identity();
  T_device_index.topLeftCorner<3, 3>() << axes.col(0) * header.spacing_mm[0], axes.col(1) * header.spacing_mm[1], step;
  T_device_index.topRightCorner<3, 1>() = origin(k);
  const auto T_field_device = mri::T_image_patient() * mri::T_device_patient(field.position).inverse();
  mri::PlaneGeometry geometry;
  geometry.T_field_index = T_field_device.matrix() * T_device_index;
  geometry.columns = static_cast<int>(header.columns);
  geometry.rows = static_cast<int>(header.rows);

  const mri::PlaneCorrection &correction = plane(geometry);
  std::vector<std::span<const std::uint16_t>> slices;
  for (int i = first; i <= last; ++i) {
    slices.emplace_back(received_[static_cast<std::size_t>(i)].pixels);
  }
  CorrectedPixels out;
  out.pixels.resize(slice.pixels.size());
  correction.apply<std::uint16_t>(slices, k - first, out.pixels);
  out.summary = correction.summary();
  out.missing_fraction = correction.missing_fraction(static_cast<int>(slices.size()), k - first);
  out.correction = out.missing_fraction > kComplete || slices.size() == 1 ? bregma_wire_CORRECTION_BREGMA_2D
                                                                          : bregma_wire_CORRECTION_BREGMA_3D;
  return out;
}

} // namespace bregma::server
