#include "casefile/volumes/volume.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <limits>
#include <sstream>
#include <string_view>
#include <system_error>

#include <Eigen/Eigenvalues> // before ITK brings its own, older copy
#include <Eigen/LU>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>
#include <unistd.h>

#include "base/text.hpp"
#include "casefile/volumes/dicom_file.hpp"
#include "casefile/volumes/image_header.hpp"
#include "casefile/volumes/itk_grid.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

// Maximal cosine between two columns of the index-to-world matrix. Above it the grid counts as sheared.
constexpr double kShearTolerance = 1e-3;

itk::ImageIOBase::Pointer image_io_of(ImageFormat format) {
  return format == ImageFormat::kNrrd ? itk::ImageIOBase::Pointer(itk::NrrdImageIO::New().GetPointer())
                                      : itk::ImageIOBase::Pointer(itk::MetaImageIO::New().GetPointer());
}

// An exception's text without ITK's source locations, classes and addresses: "itk::ERROR: GDCMImageIO(0x55d5): ".
std::string reason_of(const itk::ExceptionObject &error) {
  std::string text = error.GetDescription();
  const auto address = text.find("(0x");
  if (const auto end = text.find("): ", address); address < 64 && end != std::string::npos) {
    text.erase(0, end + 3);
  }
  if (text.starts_with("ITK ERROR: ")) {
    text.erase(0, 11);
  }
  // Teem repeats how it came to the reason, which is its last sentence.
  constexpr std::string_view kTeem = "[nrrd] ";
  if (const auto last = text.rfind(kTeem); last != std::string::npos) {
    text.erase(0, last + kTeem.size());
    const auto function = text.find(": ");
    text.erase(0, function != std::string::npos && text.find(' ') > function ? function + 2 : 0);
  }
  std::replace(text.begin(), text.end(), '\n', ' ');
  return std::string(base::trimmed(text));
}

base::Result<void> check_components(const fs::path &path, const itk::ImageIOBase &io) {
  return io.GetNumberOfComponents() == 1
             ? base::Result<void>()
             : base::failure(file_error(path, "a voxel has " + std::to_string(io.GetNumberOfComponents()) +
                                                  " components (colour or vector); a scalar image is needed"));
}

base::Result<PlacedVolume> read_stored(ImageHeader header) {
  const auto count = static_cast<std::uint64_t>(header.size[0] * header.size[1] * header.size[2]);
  const auto voxels = read_stored_voxels(*header.voxels, count);
  if (!voxels) {
    return tl::unexpected(voxels.error());
  }
  auto image = ItkVolume::New();
  image->SetRegions(ItkVolume::SizeType{static_cast<itk::SizeValueType>(header.size[0]),
                                        static_cast<itk::SizeValueType>(header.size[1]),
                                        static_cast<itk::SizeValueType>(header.size[2])});
  image->Allocate();
  std::copy(voxels->begin(), voxels->end(), image->GetBufferPointer());
  return PlacedVolume{image, header.T_ras_index, header.space_stated, std::move(header.notes), false};
}

base::Result<PlacedVolume> read_file(const fs::path &path, std::optional<Space> space) {
  const std::string name = path.string();
  const ImageFormat format = image_format_of(path);
  auto stated = read_image_header(path, format, space);
  if (!stated) {
    return tl::unexpected(stated.error());
  }
  if (stated->voxels) {
    return read_stored(std::move(*stated));
  }
  auto io = image_io_of(format);
  io->SetFileName(name);
  io->ReadImageInformation();
  if (auto scalar = check_components(path, *io); !scalar) {
    return tl::unexpected(scalar.error());
  }
  auto reader = itk::ImageFileReader<ItkVolume>::New();
  reader->SetImageIO(io);
  reader->SetFileName(name);
  reader->Update();
  const auto size = reader->GetOutput()->GetLargestPossibleRegion().GetSize();
  for (unsigned axis = 0; axis < 3; ++axis) {
    if (static_cast<std::int64_t>(size[axis]) != stated->size[axis]) {
      return base::failure(file_error(path, "is read with " + std::to_string(size[axis]) + " voxels along axis " +
                                                std::to_string(axis + 1) + ", its header states " +
                                                std::to_string(stated->size[axis])));
    }
  }
  return PlacedVolume{ItkVolume::Pointer(reader->GetOutput()), stated->T_ras_index, stated->space_stated,
                      std::move(stated->notes), false};
}

base::Result<void> check_grid(const fs::path &path, const Eigen::Matrix4d &T) {
  const Eigen::Matrix3d A = T.topLeftCorner<3, 3>();
  const Eigen::Vector3d spacing = A.colwise().norm();
  if (!T.allFinite() || !(spacing.minCoeff() > 1e-6) || spacing.maxCoeff() > 1e3) {
    return base::failure(file_error(path, "voxel spacing of " + shown(spacing[0], 4) + " x " + shown(spacing[1], 4) +
                                              " x " + shown(spacing[2], 4) + " mm is not a spacing"));
  }
  const Eigen::Matrix3d unit = A * spacing.cwiseInverse().asDiagonal();
  if (!(std::abs(unit.determinant()) > 1e-3)) {
    return base::failure(
        file_error(path, "the direction matrix is singular (determinant " + shown(unit.determinant(), 6) + ")"));
  }
  const double shear = (unit.transpose() * unit - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (shear > kShearTolerance) {
    return base::failure(file_error(path, "the axes of the image are not at right angles (cosine " + shown(shear, 4) +
                                              "); resample it to a straight grid"));
  }
  return {};
}

// Finds the index axis along R, A and S: the assignment with the largest sum of cosines. It is unique for oblique
// images as well.
std::array<int, 3> axes_along_ras(const Eigen::Matrix4d &T) {
  const Eigen::Matrix3d cosines = T.topLeftCorner<3, 3>().colwise().normalized().cwiseAbs();
  std::array<int, 3> axes{0, 1, 2};
  std::array<int, 3> best = axes;
  double best_sum = -1.0;
  do {
    const double sum = cosines(0, axes[0]) + cosines(1, axes[1]) + cosines(2, axes[2]);
    if (sum > best_sum + 1e-9) {
      best_sum = sum;
      best = axes;
    }
  } while (std::next_permutation(axes.begin(), axes.end()));
  return best;
}

Volume in_ras_order(const ItkVolume &image, const Eigen::Matrix4d &T_stored) {
  const auto stored_size = image.GetLargestPossibleRegion().GetSize();
  const std::array<std::int64_t, 3> stored_stride{1, static_cast<std::int64_t>(stored_size[0]),
                                                  static_cast<std::int64_t>(stored_size[0] * stored_size[1])};
  const std::array<int, 3> axes = axes_along_ras(T_stored);

  Volume out;
  Eigen::Matrix4d T_stored_from_new = Eigen::Matrix4d::Zero();
  T_stored_from_new(3, 3) = 1.0;
  std::array<std::int64_t, 3> stride{};
  std::int64_t start = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto from = static_cast<std::size_t>(axes[static_cast<std::size_t>(axis)]);
    const auto to = static_cast<std::size_t>(axis);
    const auto length = static_cast<std::int64_t>(stored_size[static_cast<unsigned>(from)]);
    const bool backwards = T_stored(axis, static_cast<int>(from)) < 0.0;
    out.size[to] = static_cast<int>(length);
    stride[to] = backwards ? -stored_stride[from] : stored_stride[from];
    start += backwards ? (length - 1) * stored_stride[from] : 0;
    T_stored_from_new(static_cast<int>(from), axis) = backwards ? -1.0 : 1.0;
    T_stored_from_new(static_cast<int>(from), 3) = backwards ? static_cast<double>(length - 1) : 0.0;
  }
  out.T_image_index = T_stored * T_stored_from_new;
  out.voxels.reserve(image.GetLargestPossibleRegion().GetNumberOfPixels());
  const float *stored = image.GetBufferPointer();
  for (int k = 0; k < out.size[2]; ++k) {
    for (int j = 0; j < out.size[1]; ++j) {
      for (int i = 0; i < out.size[0]; ++i) {
        out.voxels.push_back(stored[start + i * stride[0] + j * stride[1] + k * stride[2]]);
      }
    }
  }
  return out;
}

base::Result<void> check_finite(const fs::path &path, const Volume &volume) {
  const auto bad = std::find_if(volume.voxels.begin(), volume.voxels.end(), [](float v) { return !std::isfinite(v); });
  if (bad == volume.voxels.end()) {
    return {};
  }
  const auto count = std::count_if(bad, volume.voxels.end(), [](float v) { return !std::isfinite(v); });
  return base::failure(file_error(path, std::to_string(count) + " of " + std::to_string(volume.voxels.size()) +
                                            " voxels are not finite numbers"));
}

// Writes a new file next to it, which replaces it once it is whole: ITK's writers of NIfTI and MetaImage report success
// on a full disk.
base::Result<void> write_checked(const fs::path &path,
                                 const std::function<base::Result<void>(const fs::path &)> &write) {
  std::error_code error;
  const fs::path place = fs::is_symlink(path, error) ? fs::weakly_canonical(path, error) : path;
  if (fs::exists(place, error) && !fs::is_regular_file(place, error)) {
    return base::failure(file_error(path, "cannot be written: it is not a file"));
  }
  fs::path fresh = place;
  // The format is known by the extension, so that the name has something before it: what no file of a user has.
  fresh.replace_filename("." + std::to_string(::getpid()) + "-" + place.filename().string());
  const fs::path folder = fresh.has_parent_path() ? fresh.parent_path() : fs::path(".");
  if (!fs::is_directory(folder, error)) {
    return base::failure(file_error(path, "cannot be written: its folder does not exist"));
  }
  auto done = write(fresh);
  if (done) {
    if (const auto whole = read_image_header(fresh, image_format_of(fresh), std::nullopt); !whole) {
      done = base::failure(file_error(path, "cannot be written as a whole file: " + whole.error().message));
    }
  }
  // Before the new file is removed.
  if (const auto space = fs::space(folder, error); !done && !error && space.available == 0) {
    done = base::failure(file_error(path, "cannot be written: the disk is full"));
  }
  if (done) {
    fs::rename(fresh, place, error);
    done = error ? base::failure(file_error(path, "cannot be written: " + error.message())) : base::Result<void>();
  }
  if (!done) {
    fs::remove(fresh, error);
  }
  return done;
}

bool is_dicom_image(const fs::path &path) {
  return image_format_of(path) == ImageFormat::kDicom && base::lower(path.filename().string()) != "dicomdir";
}

base::Result<PlacedVolume> read_any_file(const fs::path &path, std::optional<Space> space) {
  if (is_dicom_image(path)) {
    const auto header = read_dicom_file(path);
    if (!header) {
      return tl::unexpected(header.error());
    }
    if (header->frame_count > 1) {
      return read_dicom_frames(path);
    }
  }
  return read_file(path, space);
}

} // namespace

std::string file_error(const fs::path &path, const std::string &what) { return path.string() + ": " + what; }

std::string shown(double value, int digits) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

base::Result<Volume> read_volume(const fs::path &path, const VolumeOptions &options, Notes *notes) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) {
    return base::failure(file_error(path, "no such file or folder"));
  }
  itk::Object::SetGlobalWarningDisplay(false); // relevant problems are returned as an Error
  try {
    const auto image =
        fs::is_directory(path, ignored) ? read_dicom_series(path, options.series) : read_any_file(path, options.space);
    if (!image) {
      return tl::unexpected(image.error());
    }
    if (notes == nullptr && ((!image->space_stated && !options.space) || image->resampled)) {
      return base::failure(image->notes.back());
    }
    if (auto grid = check_grid(path, image->T_ras_index); !grid) {
      return tl::unexpected(grid.error());
    }
    if (notes != nullptr) {
      notes->insert(notes->end(), image->notes.begin(), image->notes.end());
    }
    Volume volume = in_ras_order(*image->voxels, image->T_ras_index);
    if (auto finite = check_finite(path, volume); !finite) {
      return tl::unexpected(finite.error());
    }
    return volume;
  } catch (const itk::ExceptionObject &error) {
    return base::failure(file_error(path, "cannot be read: " + reason_of(error)));
  } catch (const std::exception &error) {
    return base::failure(file_error(path, std::string("cannot be read: ") + error.what()));
  }
}

bool states_its_space(const fs::path &path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored) || is_dicom_image(path)) {
    return true;
  }
  const auto header = read_image_header(path, image_format_of(path), std::nullopt);
  return header && header->space_stated;
}

base::Result<LabelVolume> read_labels(const fs::path &path, const VolumeOptions &options, Notes *notes) {
  auto volume = read_volume(path, options, notes);
  if (!volume) {
    return tl::unexpected(volume.error());
  }
  LabelVolume labels{{volume->size, volume->T_image_index}, {}};
  labels.voxels.reserve(volume->voxels.size());
  for (const float value : volume->voxels) {
    if (value != std::round(value) || std::abs(value) > float{std::numeric_limits<std::int16_t>::max()}) {
      return base::failure(file_error(path, "is not a label image: it has a voxel of value " + shown(value, 3) +
                                                ", regions are whole numbers up to 32767"));
    }
    labels.voxels.push_back(static_cast<std::int16_t>(value));
  }
  return labels;
}

base::Result<void> write_volume(const fs::path &path, const Volume &volume) {
  const std::string name = base::lower(path.string());
  itk::ImageIOBase::Pointer io;
  if (name.ends_with(".nii") || name.ends_with(".nii.gz")) {
    io = itk::NiftiImageIO::New();
  } else if (name.ends_with(".nrrd")) {
    io = itk::NrrdImageIO::New();
  } else if (name.ends_with(".mha")) {
    io = itk::MetaImageIO::New();
  } else {
    return base::failure(file_error(path, "cannot be written: the extension is none of .nii, .nii.gz, .nrrd, .mha"));
  }
  auto image = ItkVolume::New();
  ItkVolume::SizeType size;
  ItkVolume::SpacingType spacing;
  ItkVolume::PointType origin;
  ItkVolume::DirectionType direction;
  for (unsigned row = 0; row < 3; ++row) {
    const double sign = row < 2 ? -1.0 : 1.0; // RAS to LPS
    size[row] = static_cast<itk::SizeValueType>(volume.size[row]);
    spacing[row] = volume.spacing_mm()[row];
    origin[row] = sign * volume.T_image_index(row, 3);
    for (unsigned column = 0; column < 3; ++column) {
      direction[row][column] = sign * volume.T_image_index(row, column) / volume.spacing_mm()[column];
    }
  }
  const bool compressed = !name.ends_with(".nii");
  return write_checked(path, [&](const fs::path &fresh) -> base::Result<void> {
    try {
      image->SetRegions(size);
      image->SetSpacing(spacing);
      image->SetOrigin(origin);
      image->SetDirection(direction);
      image->Allocate();
      std::copy(volume.voxels.begin(), volume.voxels.end(), image->GetBufferPointer());
      auto writer = itk::ImageFileWriter<ItkVolume>::New();
      writer->SetImageIO(io);
      writer->SetFileName(fresh.string());
      writer->SetInput(image);
      writer->SetUseCompression(compressed);
      writer->Update();
    } catch (const itk::ExceptionObject &error) {
      return base::failure(file_error(path, "cannot be written: " + reason_of(error)));
    }
    return {};
  });
}

} // namespace bregma::casefile
