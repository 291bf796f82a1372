// A DICOM series is a set of slices, each with its own position. Slices that are stacked at equal gaps along their
// common normal are a volume; others are resampled to one, or refused. Other tags about "slice spacing" are not used.
#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include <Eigen/Core>
#include <Eigen/Eigenvalues> // before ITK brings its own, older copy
#include <Eigen/Geometry>
#include <gdcmTrace.h>
#include <itkGDCMImageIO.h>
#include <itkGDCMSeriesFileNames.h>
#include <itkImageSeriesReader.h>
#include <itkMetaDataObject.h>

#include "base/text.hpp"
#include "casefile/volumes/dicom_file.hpp"
#include "casefile/volumes/itk_grid.hpp"
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

struct Slice {
  std::string file;
  std::string name;                                      // the file's name without its folder, for messages
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero(); // LPS, centre of the first pixel
  Eigen::Vector3d row = Eigen::Vector3d::Zero();         // direction in which columns count up
  Eigen::Vector3d column = Eigen::Vector3d::Zero();
  Eigen::Vector2d spacing_mm = Eigen::Vector2d::Zero(); // along row, along column
  std::array<std::int64_t, 2> size{};
  double depth_mm = 0.0; // along the common normal
};

std::string series_error(const fs::path &folder, const std::string &what) {
  return folder.string() + ": the DICOM series " + what;
}

// The numbers of a multi-valued decimal string, "a\b\c"; empty where the tag is absent or not numbers.
std::vector<double> numbers(const itk::MetaDataDictionary &tags, const std::string &tag) {
  std::string text;
  itk::ExposeMetaData(tags, tag, text);
  std::replace(text.begin(), text.end(), '\\', ' ');
  std::istringstream stream(text);
  std::vector<double> values;
  for (double value = 0.0; stream >> value;) {
    values.push_back(value);
  }
  return values;
}

base::Result<Slice> read_slice(const fs::path &folder, const std::string &file) {
  auto io = itk::GDCMImageIO::New();
  io->SetFileName(file);
  io->ReadImageInformation();
  Slice slice;
  slice.file = file;
  slice.name = fs::path(file).filename().string();
  if (io->GetNumberOfDimensions() > 2 && io->GetDimensions(2) > 1) {
    return base::failure(
        series_error(folder, "holds a multi-frame file (" + slice.name +
                                 "); its slices' positions cannot be checked, convert it to single slices"));
  }
  if (io->GetNumberOfComponents() != 1) {
    return base::failure(series_error(folder, "is in colour (" + slice.name + "); a scalar image is needed"));
  }
  const auto position = numbers(io->GetMetaDataDictionary(), "0020|0032");
  const auto orientation = numbers(io->GetMetaDataDictionary(), "0020|0037");
  const auto spacing = numbers(io->GetMetaDataDictionary(), "0028|0030");
  if (position.size() != 3 || orientation.size() != 6 || spacing.size() != 2) {
    return base::failure(series_error(folder, "does not say where its slices lie: " + slice.name +
                                                  " lacks Image Position, Image Orientation or Pixel Spacing"));
  }
  slice.position_mm = Eigen::Map<const Eigen::Vector3d>(position.data());
  slice.row = Eigen::Map<const Eigen::Vector3d>(orientation.data());
  slice.column = Eigen::Map<const Eigen::Vector3d>(orientation.data() + 3);
  slice.spacing_mm = {spacing[1], spacing[0]}; // the tag gives the distance between rows first
  slice.size = {static_cast<std::int64_t>(io->GetDimensions(0)), static_cast<std::int64_t>(io->GetDimensions(1))};
  if (!(std::abs(slice.row.norm() - 1.0) < 1e-3 && std::abs(slice.column.norm() - 1.0) < 1e-3 &&
        std::abs(slice.row.dot(slice.column)) < 1e-3 && slice.position_mm.allFinite())) {
    return base::failure(series_error(folder, "has a slice (" + slice.name +
                                                  ") whose orientation is not two unit vectors at "
                                                  "right angles"));
  }
  return slice;
}

// All slices in one frame; sorted along the normal.
base::Result<void> check_consistency(const fs::path &folder, std::vector<Slice> &slices) {
  const Slice &first = slices.front();
  const Eigen::Vector3d normal = first.row.cross(first.column).normalized();
  for (Slice &slice : slices) {
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
  std::sort(slices.begin(), slices.end(), [](const Slice &a, const Slice &b) { return a.depth_mm < b.depth_mm; });
  return {};
}

struct Stack {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double gap_mm = 0.0;
  std::string uneven; // what must be resampled; empty: nothing
};

std::string between(const std::vector<Slice> &slices, const std::vector<double> &gaps, std::size_t at) {
  return shown(gaps[at], 2) + " mm (" + slices[at].name + " to " + slices[at + 1].name + ")";
}

// Gaps that no resampling can mend: one position twice, slices that are missing, and slices too far apart.
base::Result<void> check_gaps(const fs::path &folder, const std::vector<Slice> &slices, const std::vector<double> &gaps,
                              double median, double tolerance) {
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
base::Result<Stack> check_even(const fs::path &folder, const std::vector<Slice> &slices) {
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

  Stack out;
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
  for (const Slice &slice : slices) {
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
PlacedVolume even_stack(const fs::path &folder, const std::vector<Slice> &slices, const Stack &found,
                        const ItkVolume &image, std::vector<std::string> notes) {
  const Slice &first = slices.front();
  SliceStack stack{first.size, first.spacing_mm, {}, {}};
  const Eigen::Vector3d column = found.normal.cross(first.row.normalized()); // at a right angle to the row
  for (const Slice &slice : slices) {
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

std::string tag_text(const itk::MetaDataDictionary &tags, const std::string &tag) {
  std::string text;
  itk::ExposeMetaData(tags, tag, text);
  return std::string(base::trimmed(text.substr(0, text.find('\0'))));
}

// "UID (T1 MPRAGE, 176 slices, 20240131)"
std::string described(const std::string &uid, const std::vector<std::string> &files) {
  auto io = itk::GDCMImageIO::New();
  io->SetFileName(files.front());
  io->ReadImageInformation();
  const std::string description = tag_text(io->GetMetaDataDictionary(), "0008|103e");
  const std::string date = tag_text(io->GetMetaDataDictionary(), "0008|0020");
  return uid + " (" + (description.empty() ? "without a description" : description) + ", " +
         std::to_string(files.size()) + (files.size() == 1 ? " file" : " files") + (date.empty() ? "" : ", " + date) +
         ")";
}

std::vector<fs::path> files_in(const fs::path &folder, bool recursive) {
  std::vector<fs::path> out;
  std::error_code error;
  const auto take = [&](const fs::directory_entry &entry) {
    if (entry.is_regular_file(error)) {
      out.push_back(entry.path());
    }
  };
  if (recursive) {
    std::for_each(fs::recursive_directory_iterator(folder, error), fs::recursive_directory_iterator(), take);
  } else {
    std::for_each(fs::directory_iterator(folder, error), fs::directory_iterator(), take);
  }
  std::sort(out.begin(), out.end());
  return out;
}

// The DICOM files of the folder. A damaged one is an error: it may be the slice at the end of a stack, which would be
// missing in silence.
base::Result<std::vector<fs::path>> whole_files(const fs::path &folder, bool recursive) {
  std::vector<fs::path> out;
  for (const fs::path &file : files_in(folder, recursive)) {
    if (!is_dicom_file(file)) {
      continue;
    }
    if (const auto whole = read_dicom_file(file); !whole) {
      return tl::unexpected(whole.error());
    }
    out.push_back(file);
  }
  return out;
}

struct SeriesFiles {
  std::vector<std::string> files;
  std::vector<std::string> notes;
};

// A folder of slices, or a folder of folders as on a CD.
base::Result<SeriesFiles> files_of(const fs::path &folder, const std::string &series) {
  const std::vector<fs::path> at_top = files_in(folder, false);
  const bool recursive = std::none_of(at_top.begin(), at_top.end(), [](const fs::path &file) {
    return file.filename() != "DICOMDIR" && is_dicom_file(file);
  });
  const auto whole = whole_files(folder, recursive);
  if (!whole) {
    return tl::unexpected(whole.error());
  }
  auto names = itk::GDCMSeriesFileNames::New();
  names->SetRecursive(recursive);
  names->SetInputDirectory(folder.string());
  const std::vector<std::string> found = names->GetSeriesUIDs();
  if (found.empty()) {
    return base::failure(folder.string() + ": the folder holds no DICOM images");
  }
  std::string list;
  std::set<std::string> used;
  for (const std::string &uid : found) {
    const std::vector<std::string> files = names->GetFileNames(uid);
    used.insert(files.begin(), files.end());
    list += (list.empty() ? "" : "; ") + described(uid, files);
  }
  if (series.empty() && found.size() > 1) {
    return base::failure(folder.string() + ": the folder holds " + std::to_string(found.size()) +
                         " DICOM series, choose one of: " + list);
  }
  if (!series.empty() && std::find(found.begin(), found.end(), series) == found.end()) {
    return base::failure(folder.string() + ": the folder holds no DICOM series " + series + ", only: " + list);
  }
  SeriesFiles out{names->GetFileNames(series.empty() ? found.front() : series), {}};
  for (const std::string &file : out.files) {
    // GDCM takes files without the mark of part 10 as well.
    if (is_dicom_file(file)) {
      continue;
    }
    if (const auto sound = read_dicom_file(file); !sound) {
      return tl::unexpected(sound.error());
    }
  }
  for (const fs::path &file : *whole) {
    if (!used.contains(file.string()) && file.filename() != "DICOMDIR") {
      out.notes.push_back(file.string() + " holds no image: it is left out");
    }
  }
  return out;
}

} // namespace

base::Result<PlacedVolume> read_dicom_series(const fs::path &folder, const std::string &series) {
  gdcm::Trace::WarningOff(); // relevant problems are returned as an Error
  gdcm::Trace::ErrorOff();
  const auto found = files_of(folder, series);
  if (!found) {
    return tl::unexpected(found.error());
  }
  std::vector<Slice> slices;
  for (const std::string &file : found->files) {
    auto slice = read_slice(folder, file);
    if (!slice) {
      return tl::unexpected(slice.error());
    }
    slices.push_back(std::move(*slice));
  }
  if (slices.size() < 3) {
    return base::failure(
        series_error(folder, "has " + std::to_string(slices.size()) + " slices, a volume needs three"));
  }
  if (auto consistent = check_consistency(folder, slices); !consistent) {
    return tl::unexpected(consistent.error());
  }
  const auto stack = check_even(folder, slices);
  if (!stack) {
    return tl::unexpected(stack.error());
  }
  const auto voxels = slices.front().size[0] * slices.front().size[1] * static_cast<std::int64_t>(slices.size());
  if (voxels > kMaxVoxels) {
    return base::failure(
        series_error(folder, "is too large: " + std::to_string(voxels) + " voxels, at most 2^30 are read"));
  }

  auto reader = itk::ImageSeriesReader<ItkVolume>::New();
  std::vector<std::string> sorted;
  std::transform(slices.begin(), slices.end(), std::back_inserter(sorted), [](const Slice &s) { return s.file; });
  reader->SetImageIO(itk::GDCMImageIO::New());
  reader->SetFileNames(sorted);
  reader->Update();
  if (reader->GetOutput()->GetLargestPossibleRegion().GetNumberOfPixels() != static_cast<itk::SizeValueType>(voxels)) {
    return base::failure(series_error(folder, "is read with another number of voxels than its slices have"));
  }

  if (!stack->uneven.empty()) {
    return even_stack(folder, slices, *stack, *reader->GetOutput(), found->notes);
  }
  // The grid that was checked, not the reader's interpretation of the headers; LPS to RAS.
  const Slice &first = slices.front();
  const Eigen::DiagonalMatrix<double, 3> flip(-1.0, -1.0, 1.0);
  PlacedVolume out{reader->GetOutput(), Eigen::Matrix4d::Identity(), true, found->notes, false};
  out.T_ras_index.col(0).head<3>() = first.spacing_mm[0] * (flip * first.row);
  out.T_ras_index.col(1).head<3>() = first.spacing_mm[1] * (flip * first.column);
  out.T_ras_index.col(2).head<3>() = stack->gap_mm * (flip * stack->normal);
  out.T_ras_index.col(3).head<3>() = flip * first.position_mm;
  return out;
}

} // namespace bregma::casefile
