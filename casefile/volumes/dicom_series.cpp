// A DICOM series: a set of files, each a slice, or one file with many frames.
#include <algorithm>
#include <optional>
#include <set>
#include <utility>

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

// A tag of numbers.
struct NumberTag {
  const char *tag;
  const char *name;
  std::size_t count;
};

base::Result<std::vector<double>> numbers(const itk::MetaDataDictionary &tags, const NumberTag &of) {
  std::string text;
  if (!itk::ExposeMetaData(tags, of.tag, text)) {
    return base::failure(std::string("lacks ") + of.name);
  }
  std::vector<double> values = decimal_numbers(text);
  if (values.size() != of.count) {
    constexpr std::size_t kShown = 64;
    return base::failure(std::string("states ") + of.name + " as \"" +
                         std::string(base::trimmed(text.substr(0, kShown))) + "\", not as " + std::to_string(of.count) +
                         " numbers");
  }
  return values;
}

// GDCM takes a scale that it cannot read, or of 0, as 1, and inverts MONOCHROME1.
base::Result<void> check_values(const itk::MetaDataDictionary &tags) {
  for (const NumberTag &of :
       {NumberTag{"0028|1052", "Rescale Intercept", 1}, NumberTag{"0028|1053", "Rescale Slope", 1}}) {
    const auto value = tags.HasKey(of.tag) ? numbers(tags, of) : std::vector<double>{1.0};
    if (!value) {
      return tl::unexpected(value.error());
    }
    if (value->front() == 0.0 && of.tag == std::string_view("0028|1053")) {
      return base::failure("states a Rescale Slope of 0");
    }
  }
  std::string meaning;
  itk::ExposeMetaData(tags, "0028|0004", meaning);
  if (base::trimmed(meaning).starts_with("MONOCHROME1")) {
    return base::failure("states inverted values (MONOCHROME1), which are not read");
  }
  return {};
}

std::string tag_text(const itk::MetaDataDictionary &tags, const std::string &tag) {
  std::string text;
  itk::ExposeMetaData(tags, tag, text);
  return std::string(base::trimmed(text.substr(0, text.find('\0'))));
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
  if (const std::string type = tag_text(io->GetMetaDataDictionary(), "0008|0008");
      type.find("MOSAIC") != std::string::npos) {
    return base::failure(series_error(folder, "is a mosaic (" + slice.name + ", image type " + type +
                                                  "): its tiles are slices; convert it to NIfTI"));
  }
  const auto position = numbers(io->GetMetaDataDictionary(), {"0020|0032", "Image Position", 3});
  const auto orientation = numbers(io->GetMetaDataDictionary(), {"0020|0037", "Image Orientation", 6});
  const auto spacing = numbers(io->GetMetaDataDictionary(), {"0028|0030", "Pixel Spacing", 2});
  for (const auto *stated : {&position, &orientation, &spacing}) {
    if (!*stated) {
      return base::failure(
          series_error(folder, "does not say where its slices lie: " + slice.name + " " + stated->error().message));
    }
  }
  if (auto sound = check_values(io->GetMetaDataDictionary()); !sound) {
    return base::failure(
        series_error(folder, "does not say what its values are: " + slice.name + " " + sound.error().message));
  }
  slice.position_mm = Eigen::Map<const Eigen::Vector3d>(position->data());
  slice.row = Eigen::Map<const Eigen::Vector3d>(orientation->data());
  slice.column = Eigen::Map<const Eigen::Vector3d>(orientation->data() + 3);
  slice.spacing_mm = {(*spacing)[1], (*spacing)[0]}; // the tag gives the distance between rows first
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

struct Listing {
  std::vector<fs::path> files, folders;
};

// With those of its folders, as on a CD.
base::Result<Listing> listing_of(const fs::path &folder) {
  Listing out;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code ignored;
    if (entry->is_symlink(ignored) && !entry->exists(ignored)) { // GDCM's list ends there
      return base::failure(entry->path().string() + ": is a link to a file that is missing");
    }
    if (entry->is_regular_file(ignored)) {
      out.files.push_back(entry->path());
    } else if (entry->is_directory(ignored)) {
      out.folders.push_back(entry->path());
    }
  }
  if (error) {
    return base::failure(folder.string() + ": cannot be listed: " + error.message());
  }
  std::sort(out.files.begin(), out.files.end());
  std::sort(out.folders.begin(), out.folders.end());
  return out;
}

bool is_list(const fs::path &file) { return base::lower(file.filename().string()) == "dicomdir"; }

// Equal for the slices of a series: the path with its numbers left out.
std::string pattern_of(const fs::path &file) {
  std::string name = base::lower(file.filename().string());
  std::erase_if(name, [](char c) { return c >= '0' && c <= '9'; });
  return (file.parent_path() / name).string();
}

struct FolderFiles {
  struct Image {
    fs::path file;
    DicomFile header;
  };
  std::vector<Image> dicom;     // whole
  std::vector<fs::path> others; // without the mark of DICOM
  std::vector<fs::path> folders;
};

// A damaged file is an error: it may be the slice at the end of a stack, which would be missing in silence.
base::Result<FolderFiles> whole_files(const fs::path &folder) {
  auto listing = listing_of(folder);
  if (!listing) {
    return tl::unexpected(listing.error());
  }
  FolderFiles out;
  out.folders = std::move(listing->folders);
  for (const fs::path &file : listing->files) {
    if (!is_dicom_file(file)) {
      out.others.push_back(file);
      continue;
    }
    auto whole = read_dicom_file(file);
    if (!whole) {
      return tl::unexpected(whole.error());
    }
    if (!whole->has_pixels && whole->rows > 1 && whole->columns > 1) {
      return base::failure(file.string() + ": is not whole: its header states " + std::to_string(whole->columns) +
                           " x " + std::to_string(whole->rows) + " pixels, and it holds none");
    }
    out.dicom.push_back({file, std::move(*whole)});
  }
  return out;
}

// What is left out is named; a file that seems to be a slice of the series is refused. used: the files of all series.
base::Result<std::vector<std::string>> notes_of_others(const FolderFiles &files, const std::string &series,
                                                       const std::set<std::string> &used) {
  std::vector<std::string> out;
  std::set<std::string> patterns;
  for (const auto &[file, header] : files.dicom) {
    if (used.contains(file.string())) {
      patterns.insert(pattern_of(file));
    } else if (header.has_pixels && header.series == series) {
      return base::failure(file.string() + ": is a slice of the series that cannot be read");
    } else if (!is_list(file)) {
      out.push_back(file.string() + (header.has_pixels ? " cannot be read" : " holds no image") + ": it is left out");
    }
  }
  const auto like_slice = [&patterns](const fs::path &file) {
    const std::string extension = base::lower(file.extension().string());
    return patterns.contains(pattern_of(file)) || extension == ".dcm" || extension == ".ima" || extension == ".dicom";
  };
  for (const fs::path &folder : files.folders) {
    const auto inside = used.lower_bound((folder / "").string());
    if (like_slice(folder) && (inside == used.end() || !inside->starts_with((folder / "").string()))) {
      return base::failure(folder.string() + ": is named like a slice, and is a folder without slices");
    }
  }
  constexpr std::size_t kMaxNamed = 5;
  std::string names;
  std::size_t count = 0;
  for (const fs::path &file : files.others) {
    if (used.contains(file.string())) {
      continue;
    }
    if (like_slice(file)) {
      return base::failure(file.string() + ": is named like a slice, and is no DICOM file: is it damaged?");
    }
    names += ++count > kMaxNamed ? "" : (names.empty() ? "" : ", ") + file.string();
  }
  if (count > 0) {
    out.push_back(names + (count > kMaxNamed ? " and " + std::to_string(count - kMaxNamed) + " more" : "") +
                  (count == 1 ? " is no DICOM file: it is left out" : " are no DICOM files: they are left out"));
  }
  return out;
}

struct SliceHeader {
  std::string name;
  DicomFile header;
};

// Programs that move or anonymise images join what is not of one scan. Names of patients are not printed.
base::Result<void> check_one_scan(const fs::path &folder, const std::vector<SliceHeader> &slices) {
  for (const auto &[what, text] :
       {std::pair("of two patients", &DicomFile::patient_id),
        {"of two patients", &DicomFile::patient_name},
        {"in two frames of reference: the patient may have moved between them", &DicomFile::frame_of_reference}}) {
    const SliceHeader *first = nullptr;
    for (const SliceHeader &slice : slices) {
      if ((slice.header.*text).empty()) {
        continue;
      }
      if (first == nullptr) {
        first = &slice;
      } else if (slice.header.*text != first->header.*text) {
        return base::failure(
            series_error(folder, std::string("has slices ") + what + " (" + first->name + " and " + slice.name + ")"));
      }
    }
  }
  return {};
}

// Slices that are missing at an end leave no gap.
std::vector<std::string> notes_of_numbers(const fs::path &folder, const std::vector<SliceHeader> &slices) {
  std::vector<std::string> out;
  std::optional<double> first;
  double stated = 0.0;
  for (const auto &[name, header] : slices) {
    if (header.instance && header.frame_count == 1) {
      first = std::min(first.value_or(*header.instance), *header.instance);
    }
    stated = std::max(stated, header.images_in_acquisition.value_or(0.0));
  }
  if (first && *first > 1.0) {
    out.push_back(series_error(folder, "has slices that are numbered from " + shown(*first, 0) +
                                           " on: if there are earlier ones, they are missing"));
  }
  if (slices.size() > 1 && stated > static_cast<double>(slices.size())) {
    out.push_back(series_error(folder, "has " + std::to_string(slices.size()) + " files, which state " +
                                           shown(stated, 0) + " images in their acquisition"));
  }
  return out;
}

struct SeriesFiles {
  std::vector<std::string> files;
  std::vector<std::string> notes;
};

// A folder of slices, or a folder of folders as on a CD.
base::Result<SeriesFiles> files_of(const fs::path &folder, const std::string &series) {
  const auto files = whole_files(folder);
  if (!files) {
    return tl::unexpected(files.error());
  }
  auto names = itk::GDCMSeriesFileNames::New();
  names->SetRecursive(true);
  names->SetInputDirectory(folder.string());
  const std::vector<std::string> found = names->GetSeriesUIDs();
  if (found.empty()) {
    return base::failure(folder.string() + ": the folder holds no DICOM images");
  }
  std::string list;
  std::set<std::string> used;
  for (const std::string &uid : found) {
    const std::vector<std::string> slices = names->GetFileNames(uid);
    used.insert(slices.begin(), slices.end());
    list += (list.empty() ? "" : "; ") + described(uid, slices);
  }
  if (series.empty() && found.size() > 1) {
    return base::failure(folder.string() + ": the folder holds " + std::to_string(found.size()) +
                         " DICOM series, choose one of: " + list);
  }
  if (!series.empty() && std::find(found.begin(), found.end(), series) == found.end()) {
    return base::failure(folder.string() + ": the folder holds no DICOM series " + series + ", only: " + list);
  }
  const std::string &chosen = series.empty() ? found.front() : series;
  SeriesFiles out{names->GetFileNames(chosen), {}};
  std::vector<SliceHeader> slices;
  for (const std::string &file : out.files) {
    const auto walked = std::find_if(files->dicom.begin(), files->dicom.end(),
                                     [&file](const FolderFiles::Image &image) { return image.file == file; });
    if (walked != files->dicom.end()) {
      slices.push_back({walked->file.filename().string(), walked->header});
      continue;
    }
    // GDCM takes files without the mark of part 10 as well.
    auto sound = read_dicom_file(file);
    if (!sound) {
      return tl::unexpected(sound.error());
    }
    slices.push_back({fs::path(file).filename().string(), std::move(*sound)});
  }
  if (auto one = check_one_scan(folder, slices); !one) {
    return tl::unexpected(one.error());
  }
  auto notes = notes_of_others(*files, chosen, used);
  if (!notes) {
    return tl::unexpected(notes.error());
  }
  out.notes = notes_of_numbers(folder, slices);
  out.notes.insert(out.notes.end(), notes->begin(), notes->end());
  return out;
}

// The first file whose pixels cannot be read; empty if there is none.
std::string undecodable_slice(const std::vector<std::string> &files) {
  for (const std::string &file : files) {
    auto reader = itk::ImageFileReader<ItkVolume>::New();
    reader->SetImageIO(itk::GDCMImageIO::New());
    reader->SetFileName(file);
    try {
      reader->Update();
    } catch (const itk::ExceptionObject &) {
      return file;
    }
  }
  return {};
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
  try {
    reader->Update();
  } catch (const itk::ExceptionObject &) {
    const std::string damaged = undecodable_slice(sorted);
    if (damaged.empty()) {
      throw;
    }
    return base::failure(damaged + ": its pixels cannot be decoded: is it damaged?");
  }
  const auto pixels = static_cast<itk::SizeValueType>(slices.front().size[0] * slices.front().size[1]);
  if (reader->GetOutput()->GetLargestPossibleRegion().GetNumberOfPixels() != pixels * slices.size()) {
    return base::failure(series_error(folder, "is read with another number of voxels than its slices have"));
  }

  return placed(folder, slices, *stack, reader->GetOutput(), found->notes);
}

} // namespace bregma::casefile
