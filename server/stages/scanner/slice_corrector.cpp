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
constexpr double kSameMovement = 1e-3; // relative: read-outs that differ by less are the same
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
    missing_.assign(slice.header.count, 0.0);
  }
  newest_ = static_cast<int>(slice.header.index) - 1;
  received_[slice.header.index - 1] = slice;
}

bool SliceCorrector::has(int index) const {
  return index >= 0 && index < static_cast<int>(received_.size()) &&
         !received_[static_cast<std::size_t>(index)].pixels.empty();
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
  const Eigen::Vector3d mm_per_Hz = in_field(field, movement_by_b0(header));
  if (field.scans->is_opposite(mm_per_Hz)) {
    return base::failure("the distortion field was measured with the opposite read-out, so B0 would be doubled");
  }
  const bool other_field = scans_ != field.scans;
  if (other_field || (field.scans->has_b0() && (mm_per_Hz - mm_per_Hz_).norm() > kSameMovement * mm_per_Hz.norm())) {
    scans_ = field.scans;
    mm_per_Hz_ = mm_per_Hz;
    table_ = scans_->of_scan(mm_per_Hz);
    planes_.clear();
  }
  position_ = field.position;
  remember(slice);
  const Window window = window_of(newest_);
  missing_[static_cast<std::size_t>(newest_)] = window.missing_fraction;
  return correct_at(newest_, window);
}

std::optional<CorrectedPixels> SliceCorrector::correct_again() {
  const bool ended =
      std::all_of(received_.begin(), received_.end(), [](const OwnedSlice &slice) { return !slice.pixels.empty(); });
  const auto count = static_cast<int>(received_.size());
  for (int k = std::max(0, newest_ - kReach); k <= std::min(count - 1, newest_ + kReach); ++k) {
    double &before = missing_[static_cast<std::size_t>(k)];
    if (k == newest_ || before <= kComplete) {
      continue;
    }
    const Window window = window_of(k);
    if (window.missing_fraction <= kComplete || (ended && window.missing_fraction < before - kComplete)) {
      before = 0.0;
      return correct_at(k, window);
    }
  }
  return std::nullopt;
}

SliceCorrector::Window SliceCorrector::window_of(int k) {
  const wire::ImageSlice &header = received_[static_cast<std::size_t>(k)].header;
  Window out{k, k};
  while (k - out.first < kReach && has(out.first - 1)) {
    --out.first;
  }
  while (out.last - k < kReach && has(out.last + 1)) {
    ++out.last;
  }
  const auto origin = [&](int i) {
    return Eigen::Vector3d::Map(received_[static_cast<std::size_t>(i)].header.T_scanner_slice.translation_mm);
  };
  const Eigen::Matrix3d axes = axes_of(header);
  const double thickness = header.thickness_mm > 0.0 ? header.thickness_mm : 1.0;
  Eigen::Vector3d step = thickness * axes.col(2);
  if (out.last > out.first) {
    step = (origin(out.last) - origin(out.first)) / (out.last - out.first);
  }
  Eigen::Matrix4d T_device_index = Eigen::Matrix4d::Identity();
  T_device_index.topLeftCorner<3, 3>() << axes.col(0) * header.spacing_mm[0], axes.col(1) * header.spacing_mm[1], step;
  T_device_index.topRightCorner<3, 1>() = origin(k);
  const auto T_field_device = mri::T_image_patient() * mri::T_device_patient(position_).inverse();
  mri::PlaneGeometry geometry;
  geometry.T_field_index = T_field_device.matrix() * T_device_index;
  geometry.columns = static_cast<int>(header.columns);
  geometry.rows = static_cast<int>(header.rows);
  out.plane = &plane(geometry);
  out.missing_fraction = out.plane->missing_fraction(out.last - out.first + 1, k - out.first);
  return out;
}

CorrectedPixels SliceCorrector::correct_at(int k, const Window &window) {
  const OwnedSlice &slice = received_[static_cast<std::size_t>(k)];
  std::vector<std::span<const std::uint16_t>> slices;
  for (int i = window.first; i <= window.last; ++i) {
    slices.emplace_back(received_[static_cast<std::size_t>(i)].pixels);
  }
  CorrectedPixels out;
  out.header = slice.header;
  out.pixels.resize(slice.pixels.size());
  window.plane->apply<std::uint16_t>(slices, k - window.first, out.pixels);
  out.summary = window.plane->summary();
  out.missing_fraction = window.missing_fraction;
  out.correction = out.missing_fraction > kComplete || slices.size() == 1 ? bregma_wire_CORRECTION_BREGMA_2D
                                                                          : bregma_wire_CORRECTION_BREGMA_3D;
  return out;
}

} // namespace bregma::server
