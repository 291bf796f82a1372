// A DICOM series: a set of files, each a slice, or one file with many frames.
#include <algorithm>
#include <set>
#include <sstream>

#include <Eigen/Core>
#include <Eigen/Eigenvalues> // before ITK brings its own, older copy
#include <gdcmTrace.h>
#include <itkGDCMImageIO.h>
#include <itkGDCMSeriesFileNames.h>
#include <itkImageFileReader.h>
#include <itkImageSeriesReader.h>
#include <itkMetaDataObject.h>

#include "base/text.hpp"
#include "casefile/volumes/dicom_file.hpp"
#include "casefile/volumes/dicom_stack.hpp"
#include "casefile/volumes/itk_grid.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

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

base::Result<DicomSlice> read_slice(const fs::path &folder, const std::string &file) {
  auto io = itk::GDCMImageIO::New();
  io->SetFileName(file);
  io->ReadImageInformation();
  DicomSlice slice;
  slice.file = file;
  slice.name = fs::path(file).filename().string();
  if (io->GetNumberOfDimensions() > 2 && io->GetDimensions(2) > 1) {
    return base::failure(series_error(folder, "holds several files, and one of many frames (" + slice.name +
                                                  "): give that file, or another, alone"));
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
  if (auto sound = check_slice(folder, slice); !sound) {
    return tl::unexpected(sound.error());
  }
  return slice;
}

// The frames of a file in its order, by its functional groups.
base::Result<std::vector<DicomSlice>> frames_of(const fs::path &file, const DicomFile &header) {
  if (header.frames.size() != header.frame_count) {
    return base::failure(file.string() + ": holds " + std::to_string(header.frame_count) + " frames, and states of " +
                         std::to_string(header.frames.size()) +
                         " where they lie: only enhanced multi-frame images are read");
  }
  std::vector<DicomSlice> out;
  for (const DicomFrame &frame : header.frames) {
    DicomSlice slice;
    slice.file = file.string();
    slice.frame = out.size();
    slice.name = "frame " + std::to_string(out.size() + 1);
    if (!frame.position_mm || !frame.orientation || !frame.spacing_mm) {
      return base::failure(file.string() + ": does not say where its frames lie: " + slice.name +
                           " lacks Image Position, Image Orientation or Pixel Spacing");
    }
    if (frame.slope && !(std::abs(*frame.slope) > 0.0)) {
      return base::failure(file.string() + ": the scale of the values of " + slice.name + " is not a number, or 0");
    }
    slice.position_mm = *frame.position_mm;
    slice.row = frame.orientation->head<3>();
    slice.column = frame.orientation->tail<3>();
    slice.spacing_mm = frame.spacing_mm->reverse();
    slice.size = {static_cast<std::int64_t>(header.columns), static_cast<std::int64_t>(header.rows)};
    if (auto sound = check_slice(file, slice); !sound) {
      return tl::unexpected(sound.error());
    }
    out.push_back(std::move(slice));
  }
  return out;
}

// GDCM's voxels in the order of the slices. Each frame may have a scale of its own values, where GDCM has one for all,
// or none.
base::Result<ItkVolume::Pointer> read_frames(const fs::path &file, const DicomFile &header,
                                             const std::vector<DicomSlice> &slices) {
  auto io = itk::GDCMImageIO::New();
  auto reader = itk::ImageFileReader<ItkVolume>::New();
  reader->SetImageIO(io);
  reader->SetFileName(file.string());
  reader->Update();
  const ItkVolume &read = *reader->GetOutput();
  const auto size = read.GetLargestPossibleRegion().GetSize();
  if (size[0] != header.columns || size[1] != header.rows || size[2] != header.frame_count ||
      io->GetNumberOfComponents() != 1) {
    return base::failure(file.string() + ": is read as " + std::to_string(size[0]) + " x " + std::to_string(size[1]) +
                         " x " + std::to_string(size[2]) + " voxels, its header states " +
                         std::to_string(header.columns) + " x " + std::to_string(header.rows) + " x " +
                         std::to_string(header.frame_count) + ": convert it to single slices");
  }
  const double slope = io->GetRescaleSlope();
  const double intercept = io->GetRescaleIntercept();
  auto out = ItkVolume::New();
  out->SetRegions(read.GetLargestPossibleRegion());
  out->Allocate();
  const auto pixels = static_cast<std::size_t>(header.columns * header.rows);
  float *to = out->GetBufferPointer();
  for (const DicomSlice &slice : slices) {
    const DicomFrame &frame = header.frames[slice.frame];
    const double own_slope = frame.slope.value_or(1.0);
    const double own_intercept = frame.intercept.value_or(0.0);
    const float *from = read.GetBufferPointer() + slice.frame * pixels;
    if (own_slope == slope && own_intercept == intercept) {
      to = std::copy(from, from + pixels, to);
    } else {
      to = std::transform(from, from + pixels, to, [&](float value) {
        const double stored = std::round((static_cast<double>(value) - intercept) / slope);
        return static_cast<float>(own_slope * stored + own_intercept);
      });
    }
  }
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

base::Result<PlacedVolume> read_dicom_frames(const fs::path &file) {
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  const auto header = read_dicom_file(file);
  if (!header) {
    return tl::unexpected(header.error());
  }
  if (header->samples != 1 || header->bits_allocated < 8) {
    return base::failure(file.string() + (header->samples != 1 ? ": is in colour; a scalar image is needed"
                                                               : ": is a segmentation with one bit per pixel, which "
                                                                 "is not read; convert it to NIfTI"));
  }
  auto slices = frames_of(file, *header);
  if (!slices) {
    return tl::unexpected(slices.error());
  }
  const auto stack = stack_of(file, *slices);
  if (!stack) {
    return tl::unexpected(stack.error());
  }
  auto image = read_frames(file, *header, *slices);
  if (!image) {
    return tl::unexpected(image.error());
  }
  return placed(file, *slices, *stack, std::move(*image), {});
}

base::Result<PlacedVolume> read_dicom_series(const fs::path &folder, const std::string &series) {
  gdcm::Trace::WarningOff(); // relevant problems are returned as an Error
  gdcm::Trace::ErrorOff();
  const auto found = files_of(folder, series);
  if (!found) {
    return tl::unexpected(found.error());
  }
  if (found->files.size() == 1) {
    const auto header = read_dicom_file(found->files.front());
    if (header && header->frame_count > 1) {
      auto volume = read_dicom_frames(found->files.front());
      if (volume) {
        volume->notes.insert(volume->notes.begin(), found->notes.begin(), found->notes.end());
      }
      return volume;
    }
  }
  std::vector<DicomSlice> slices;
  for (const std::string &file : found->files) {
    auto slice = read_slice(folder, file);
    if (!slice) {
      return tl::unexpected(slice.error());
    }
    slices.push_back(std::move(*slice));
  }
  const auto stack = stack_of(folder, slices);
  if (!stack) {
    return tl::unexpected(stack.error());
  }

  auto reader = itk::ImageSeriesReader<ItkVolume>::New();
  std::vector<std::string> sorted;
  std::transform(slices.begin(), slices.end(), std::back_inserter(sorted), [](const DicomSlice &s) { return s.file; });
  reader->SetImageIO(itk::GDCMImageIO::New());
  reader->SetFileNames(sorted);
  reader->Update();
  const auto pixels = static_cast<itk::SizeValueType>(slices.front().size[0] * slices.front().size[1]);
  if (reader->GetOutput()->GetLargestPossibleRegion().GetNumberOfPixels() != pixels * slices.size()) {
    return base::failure(series_error(folder, "is read with another number of voxels than its slices have"));
  }

  return placed(folder, slices, *stack, reader->GetOutput(), found->notes);
}

} // namespace bregma::casefile
