// Layout of the header: nifti1.h of the NIfTI-1.1 standard.
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <sstream>

#include <itkMetaDataObject.h>

#include "casefile/volumes/itk_grid.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

// Distance between a corner of the image as placed by ITK and as placed by the file's own matrix.
constexpr double kPlacementTolerance_mm = 0.01;

constexpr std::size_t kHeaderBytes = 348;
constexpr std::size_t kDimensionsAt = 40;
constexpr std::size_t kBitsPerVoxelOffset = 72;
constexpr std::size_t kVoxelsStartAt = 108;
constexpr std::size_t kMagicAt = 344;

template <class T> T field(const std::array<char, kHeaderBytes> &header, std::size_t at, bool swapped) {
  std::array<char, sizeof(T)> bytes{};
  std::copy_n(header.begin() + static_cast<std::ptrdiff_t>(at), sizeof(T), bytes.begin());
  if (swapped) {
    std::reverse(bytes.begin(), bytes.end());
  }
  T value{};
  std::memcpy(&value, bytes.data(), sizeof value);
  return value;
}

std::string header_field(const itk::ImageIOBase &io, const std::string &key) {
  std::string value;
  itk::ExposeMetaData(io.GetMetaDataDictionary(), key, value);
  return value;
}

} // namespace

base::Result<void> check_nifti_size(const fs::path &path, const itk::ImageIOBase &io) {
  // zlib reads uncompressed files unchanged.
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose);
  std::array<char, kHeaderBytes> header{};
  if (!file || gzread(file.get(), header.data(), kHeaderBytes) != static_cast<int>(kHeaderBytes)) {
    return base::failure(file_error(path, "has no whole NIfTI header"));
  }
  const bool swapped = field<std::int32_t>(header, 0, false) != static_cast<std::int32_t>(kHeaderBytes);
  if (field<std::int32_t>(header, 0, swapped) != static_cast<std::int32_t>(kHeaderBytes) ||
      std::memcmp(header.data() + kMagicAt, "n+1", 4) != 0) {
    return base::failure(file_error(path, "is not a single-file NIfTI-1 image (.nii, .nii.gz)"));
  }
  const auto dimensions = field<std::int16_t>(header, kDimensionsAt, swapped);
  for (std::size_t axis = 1; axis <= static_cast<std::size_t>(std::clamp<std::int16_t>(dimensions, 0, 7)); ++axis) {
    if (const auto size = field<std::int16_t>(header, kDimensionsAt + 2 * axis, swapped); size < 1) {
      return base::failure(file_error(path, "the image is empty: " + std::to_string(size) + " voxels along axis " +
                                                std::to_string(axis)));
    }
  }
  const auto start = static_cast<double>(field<float>(header, kVoxelsStartAt, swapped));
  // The stored type; ITK reports that of the scaled values.
  const double needed = start + static_cast<double>(io.GetImageSizeInPixels()) *
                                    field<std::int16_t>(header, kBitsPerVoxelOffset, swapped) / 8.0;
  double found = kHeaderBytes;
  std::vector<char> block(std::size_t{1} << 18);
  int got = 0;
  while ((got = gzread(file.get(), block.data(), static_cast<unsigned>(block.size()))) > 0) {
    found += got;
  }
  int state = Z_OK;
  gzerror(file.get(), &state);
  if (state != Z_OK) {
    return base::failure(file_error(path, "is damaged: its compressed data ends early or does not match its checksum"));
  }
  if (!(start >= kHeaderBytes) || found < needed) {
    return base::failure(file_error(path, "is damaged: it holds " + shown(found, 0) + " bytes, its header asks for " +
                                              shown(needed, 0)));
  }
  return {};
}

base::Result<void> check_nifti_placement(const fs::path &path, const itk::ImageIOBase &io, const ItkVolume &image) {
  const std::string qform = header_field(io, "qform_code");
  const std::string sform = header_field(io, "sform_code");
  if (qform.starts_with('0') && sform.starts_with('0')) {
    return base::failure(file_error(path, "states no orientation (qform_code and sform_code are both 0)"));
  }
  if (sform.empty() || sform.starts_with('0')) {
    return {};
  }
  Eigen::Matrix4d stated = Eigen::Matrix4d::Identity();
  const char *const rows[] = {"srow_x", "srow_y", "srow_z"};
  for (int row = 0; row < 3; ++row) {
    std::istringstream text(header_field(io, rows[row]));
    for (int column = 0; column < 4; ++column) {
      if (!(text >> stated(row, column))) {
        return base::failure(file_error(path, std::string(rows[row]) + " of the header is not four numbers"));
      }
    }
  }
  const auto size = image.GetLargestPossibleRegion().GetSize();
  const Eigen::Vector3d last =
      Eigen::Array3d(static_cast<double>(size[0]), static_cast<double>(size[1]), static_cast<double>(size[2])) - 1.0;
  double apart = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector4d index((corner & 1) != 0 ? last[0] : 0.0, (corner & 2) != 0 ? last[1] : 0.0,
                                (corner & 4) != 0 ? last[2] : 0.0, 1.0);
    apart = std::max(apart, ((stated - ras_from_index(image)) * index).norm());
  }
  if (!(apart <= kPlacementTolerance_mm * std::max(1.0, last.norm() / 100.0))) {
    return base::failure(
        file_error(path, "its sform is sheared or contradicts its qform: a corner of the image would lie " +
                             shown(apart, 2) + " mm apart; resample the image to one of them"));
  }
  return {};
}

} // namespace bregma::casefile
