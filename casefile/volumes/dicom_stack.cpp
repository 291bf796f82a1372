#include "casefile/volumes/dicom_stack.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include <Eigen/Geometry>

#include "casefile/volumes/slice_stack.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

constexpr double kGapTolerance = 0.01;        // fraction of the median gap
constexpr double kRounding_mm = 0.06;         // positions are written with one decimal at the least
constexpr double kTiltTolerance_rad = 0.0018; // 0.1 degrees: 0.35 mm over a stack of 200 mm
constexpr double kOrientationTolerance = 1e-4;
constexpr double kLeastGap = 0.05;        // fraction of the median gap: below, two slices are in one place
constexpr double kMissingShare = 0.3;     // fraction of odd gaps up to which a double gap is a missing slice
constexpr double kLargestGap_mm = 10.0;   // that is interpolated
constexpr double kLargestTilt_rad = 0.61; // 35 degrees; gantries tilt up to 30

// All slices in one frame; sorted along the normal.
base::Result<void> check_consistency(const fs::path &folder, std::vector<DicomSlice> &slices) {
  const DicomSlice &first = slices.front();
  const Eigen::Vector3d normal = first.row.cross(first.column).normalized();
  for (DicomSlice &slice : slices) {
    const std::string pair = " (" + first.name + " and " + slice.name + ")";
    if (slice.size != first.size || (slice.spacing_mm - first.spacing_mm).norm() > 1e-4 * first.spacing_mm.norm()) {
      return base::failure(series_error(folder, "has slices of different size or pixel spacing" + pair));
    }
    if ((slice.row - first.row).norm() > kOrientationTolerance ||
        (slice.column - first.column).norm() > kOrientationTolerance) {
      return base::failure(series_error(folder, "has slices of different orientation" + pair));
    }
    slice.depth_mm = normal.dot(slice.position_mm);
  }
  std::sort(slices.begin(), slices.end(),
            [](const DicomSlice &a, const DicomSlice &b) { return a.depth_mm < b.depth_mm; });
  return {};
}

std::string between(const std::vector<DicomSlice> &slices, const std::vector<double> &gaps, std::size_t at) {
  return shown(gaps[at], 2) + " mm (" + slices[at].name + " to " + slices[at + 1].name + ")";
}

// Gaps that no resampling can mend: one position twice, slices that are missing, and slices too far apart.
base::Result<void> check_gaps(const fs::path &folder, const std::vector<DicomSlice> &slices,
                              const std::vector<double> &gaps, double median, double tolerance) {
  const auto smallest = static_cast<std::size_t>(std::min_element(gaps.begin(), gaps.end()) - gaps.begin());
  const auto largest = static_cast<std::size_t>(std::max_element(gaps.begin(), gaps.end()) - gaps.begin());
  if (gaps[smallest] <= std::max(1e-3, kLeastGap * median)) {
    return base::failure(
        series_error(folder, "has two slices in the same place, or almost: " + between(slices, gaps, smallest) +
                                 ": several acquisitions in one series?"));
  }
  const auto is_odd = [&](double gap) { return std::abs(gap - median) > tolerance; };
  const auto odd = std::count_if(gaps.begin(), gaps.end(), is_odd);
  const double times = std::round(gaps[largest] / median);
  if (times >= 2.0 && static_cast<double>(odd) < kMissingShare * static_cast<double>(gaps.size()) &&
      std::abs(gaps[largest] - times * median) <= tolerance) {
    return base::failure(series_error(folder, "lacks slices: " + std::to_string(odd) + " of " +
                                                  std::to_string(gaps.size()) + " differ from the median gap of " +
                                                  shown(median, 2) + " mm, the largest is " +
                                                  between(slices, gaps, largest)));
  }
  if (gaps[largest] > kLargestGap_mm) {
    return base::failure(series_error(folder, "is too coarse to be resampled: its largest gap is " +
                                                  between(slices, gaps, largest) + ", at most " +
                                                  shown(kLargestGap_mm, 0) + " mm are taken"));
  }
  return {};
}

// All that is uneven about the slices' positions in one sentence.
base::Result<DicomStack> check_even(const fs::path &folder, const std::vector<DicomSlice> &slices) {
  std::vector<double> gaps;
  for (std::size_t at = 1; at < slices.size(); ++at) {
    gaps.push_back(slices[at].depth_mm - slices[at - 1].depth_mm);
  }
  std::vector<double> sorted = gaps;
  std::sort(sorted.begin(), sorted.end());
  const double median = sorted[sorted.size() / 2];
  const double tolerance = 2.0 * kRounding_mm + kGapTolerance * median;
  if (auto usable = check_gaps(folder, slices, gaps, median, tolerance); !usable) {
    return tl::unexpected(usable.error());
  }

  DicomStack out;
  const double even = (slices.back().depth_mm - slices.front().depth_mm) / static_cast<double>(gaps.size());
  double off_mm = 0.0; // of a slice from an even stack
  for (std::size_t at = 0; at < slices.size(); ++at) {
    off_mm = std::max(off_mm, std::abs(slices[at].depth_mm - slices.front().depth_mm - static_cast<double>(at) * even));
  }
  if (off_mm > kRounding_mm + kGapTolerance * median) {
    const auto odd =
        std::count_if(gaps.begin(), gaps.end(), [&](double gap) { return std::abs(gap - median) > tolerance; });
    const auto smallest = static_cast<std::size_t>(std::min_element(gaps.begin(), gaps.end()) - gaps.begin());
    const auto largest = static_cast<std::size_t>(std::max_element(gaps.begin(), gaps.end()) - gaps.begin());
    out.uneven = "is unevenly spaced: the gaps between its " + std::to_string(slices.size()) + " slices run from " +
                 between(slices, gaps, smallest) + " to " + between(slices, gaps, largest) + ", " +
                 std::to_string(odd) + " of " + std::to_string(gaps.size()) + " differ from the median of " +
                 shown(median, 2) + " mm";
  }
  out.normal = slices.front().row.cross(slices.front().column).normalized();
  const Eigen::Vector3d along = slices.back().position_mm - slices.front().position_mm;
  // Sideways distances from the normal through the first slice: every slice may have its own.
  double sideways_mm = 0.0;
  for (const DicomSlice &slice : slices) {
    const Eigen::Vector3d from_first = slice.position_mm - slices.front().position_mm;
    sideways_mm = std::max(sideways_mm, (from_first - out.normal * out.normal.dot(from_first)).norm());
  }
  const double tilt = std::atan2(sideways_mm, along.dot(out.normal));
  if (tilt > kTiltTolerance_rad + 2.0 * kRounding_mm / along.norm()) {
    out.uneven += (out.uneven.empty() ? "" : "; it also ") +
                  std::string("has a tilted gantry: the slices are shifted sideways by ") +
                  shown(tilt * 180.0 / M_PI, 1) + " degrees";
    if (tilt > kLargestTilt_rad) {
      return base::failure(series_error(folder, out.uneven + ", too far to be one scan"));
    }
  }
  out.gap_mm = along.norm() / static_cast<double>(gaps.size());
  return out;
}

// An even, straight stack in place of the slices.
PlacedVolume even_stack(const fs::path &folder, const std::vector<DicomSlice> &slices, const DicomStack &found,
                        const ItkVolume &image, std::vector<std::string> notes) {
  const DicomSlice &first = slices.front();
  SliceStack stack{first.size, first.spacing_mm, {}, {}};
  const Eigen::Vector3d column = found.normal.cross(first.row.normalized()); // at a right angle to the row
  for (const DicomSlice &slice : slices) {
    stack.depths_mm.push_back(slice.depth_mm);
    stack.offsets_mm.emplace_back(first.row.normalized().dot(slice.position_mm), column.dot(slice.position_mm));
  }
  const EvenStack grid = even_grid_of(stack);
  const std::span<const float> voxels(image.GetBufferPointer(), image.GetLargestPossibleRegion().GetNumberOfPixels());
  const float outside = *std::min_element(voxels.begin(), voxels.end());
  const std::vector<float> values = resampled(stack, voxels, grid, outside);

  PlacedVolume out{ItkVolume::New(), Eigen::Matrix4d::Identity(), true, std::move(notes), true};
  ItkVolume::SizeType size;
  for (unsigned axis = 0; axis < 3; ++axis) {
    size[axis] = static_cast<itk::SizeValueType>(grid.size[axis]);
  }
  out.voxels->SetRegions(size);
  out.voxels->Allocate();
  std::copy(values.begin(), values.end(), out.voxels->GetBufferPointer());
  const Eigen::DiagonalMatrix<double, 3> flip(-1.0, -1.0, 1.0);
  out.T_ras_index.col(0).head<3>() = first.spacing_mm[0] * (flip * first.row.normalized());
  out.T_ras_index.col(1).head<3>() = first.spacing_mm[1] * (flip * column);
  out.T_ras_index.col(2).head<3>() = grid.gap_mm * (flip * found.normal);
  out.T_ras_index.col(3).head<3>() =
      flip * (first.row.normalized() * grid.offset_mm[0] + column * grid.offset_mm[1] + found.normal * first.depth_mm);
  out.notes.push_back(
      series_error(folder, found.uneven + ". It is resampled, linearly, to an even and straight grid of " +
                               std::to_string(grid.size[0]) + " x " + std::to_string(grid.size[1]) + " x " +
                               std::to_string(grid.size[2]) + " voxels with slices every " + shown(grid.gap_mm, 2) +
                               " mm; where it has no slice, the value is " + shown(static_cast<double>(outside), 0)));
  return out;
}

} // namespace

std::string series_error(const fs::path &folder, const std::string &what) {
  return folder.string() + ": the DICOM series " + what;
}

base::Result<void> check_slice(const fs::path &folder, const DicomSlice &slice) {
  if (!(slice.spacing_mm.allFinite() && slice.spacing_mm.minCoeff() > 0.0)) {
    return base::failure(series_error(folder, "has a slice (" + slice.name + ") with a pixel spacing of " +
                                                  shown(slice.spacing_mm[0], 3) + " x " +
                                                  shown(slice.spacing_mm[1], 3) + " mm"));
  }
  if (std::abs(slice.row.norm() - 1.0) < 1e-3 && std::abs(slice.column.norm() - 1.0) < 1e-3 &&
      std::abs(slice.row.dot(slice.column)) < 1e-3 && slice.position_mm.allFinite()) {
    return {};
  }
  return base::failure(series_error(folder, "has a slice (" + slice.name +
                                                ") whose orientation is not two unit vectors at right angles"));
}

base::Result<DicomStack> stack_of(const fs::path &folder, std::vector<DicomSlice> &slices) {
  if (slices.size() < 3) {
    return base::failure(
        series_error(folder, "has " + std::to_string(slices.size()) + " slices, a volume needs three"));
  }
  if (auto consistent = check_consistency(folder, slices); !consistent) {
    return tl::unexpected(consistent.error());
  }
  const auto voxels = slices.front().size[0] * slices.front().size[1] * static_cast<std::int64_t>(slices.size());
  if (voxels > kMaxVoxels) {
    return base::failure(
        series_error(folder, "is too large: " + std::to_string(voxels) + " voxels, at most 2^30 are read"));
  }
  return check_even(folder, slices);
}

PlacedVolume placed(const fs::path &folder, const std::vector<DicomSlice> &slices, const DicomStack &stack,
                    ItkVolume::Pointer image, std::vector<std::string> notes) {
  if (!stack.uneven.empty()) {
    return even_stack(folder, slices, stack, *image, std::move(notes));
  }
  // The grid that was checked, not the reader's interpretation of the headers; LPS to RAS.
  const DicomSlice &first = slices.front();
  const Eigen::DiagonalMatrix<double, 3> flip(-1.0, -1.0, 1.0);
  PlacedVolume out{std::move(image), Eigen::Matrix4d::Identity(), true, std::move(notes), false};
  out.T_ras_index.col(0).head<3>() = first.spacing_mm[0] * (flip * first.row);
  out.T_ras_index.col(1).head<3>() = first.spacing_mm[1] * (flip * first.column);
  out.T_ras_index.col(2).head<3>() = stack.gap_mm * (flip * stack.normal);
  out.T_ras_index.col(3).head<3>() = flip * first.position_mm;
  return out;
}

} // namespace bregma::casefile
