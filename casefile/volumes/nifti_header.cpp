// The header of a NIfTI-1 file in one piece: nifti1.h of the NIfTI-1.1 standard.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include <Eigen/Geometry>
#include <zlib.h>

#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kHeaderBytes = 348;
// Offsets of the fields.
constexpr std::size_t kDimensions = 40, kBitsPerVoxel = 72, kPixelSizes = 76, kVoxelsStart = 108, kUnits = 123,
                      kQformCode = 252, kSformCode = 254, kQuaternion = 256, kQuaternionOffset = 268, kRows = 280,
                      kMagic = 344;
constexpr double kPlacementTolerance_mm = 0.01; // between the file's two matrices, at a corner of the image

class NiftiBytes {
public:
  // Empty: no file, or less than a header.
  static std::optional<NiftiBytes> read(const fs::path &path) {
    // zlib reads uncompressed files unchanged.
    const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose);
    NiftiBytes out;
    if (!file || gzread(file.get(), out.bytes_.data(), kHeaderBytes) != static_cast<int>(kHeaderBytes)) {
      return std::nullopt;
    }
    out.compressed_ = gzdirect(file.get()) == 0;
    constexpr auto kSize = static_cast<std::int32_t>(kHeaderBytes);
    out.swapped_ = out.at<std::int32_t>(0) != kSize;
    return out.at<std::int32_t>(0) == kSize ? std::optional(out) : std::nullopt;
  }

  template <class T> [[nodiscard]] T at(std::size_t offset) const {
    std::array<char, sizeof(T)> bytes{};
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), sizeof(T), bytes.begin());
    if (swapped_) {
      std::reverse(bytes.begin(), bytes.end());
    }
    T value{};
    std::memcpy(&value, bytes.data(), sizeof value);
    return value;
  }
  [[nodiscard]] double number(std::size_t offset) const { return static_cast<double>(at<float>(offset)); }
  [[nodiscard]] std::string_view text(std::size_t offset, std::size_t length) const {
    return {bytes_.data() + offset, length};
  }
  [[nodiscard]] bool compressed() const { return compressed_; }

private:
  std::array<char, kHeaderBytes> bytes_{};
  bool swapped_ = false, compressed_ = false;
};

// Quaternion, offset and voxel size; the sign of the first pixel size is that of the third axis.
Eigen::Matrix4d qform_of(const NiftiBytes &header) {
  const Eigen::Vector3d v(header.number(kQuaternion), header.number(kQuaternion + 4), header.number(kQuaternion + 8));
  const double squared = v.squaredNorm();
  const Eigen::Quaterniond q = squared > 1.0 ? Eigen::Quaterniond(0.0, v.x(), v.y(), v.z()).normalized()
                                             : Eigen::Quaterniond(std::sqrt(1.0 - squared), v.x(), v.y(), v.z());
  const Eigen::Vector3d size(header.number(kPixelSizes + 4), header.number(kPixelSizes + 8),
                             header.number(kPixelSizes + 12));
  const double third = header.number(kPixelSizes) < 0.0 ? -1.0 : 1.0;
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = q.toRotationMatrix() * Eigen::Vector3d(size.x(), size.y(), third * size.z()).asDiagonal();
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    out(axis, 3) = header.number(kQuaternionOffset + 4 * static_cast<std::size_t>(axis));
  }
  return out;
}

Eigen::Matrix4d sform_of(const NiftiBytes &header) {
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      out(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column)) =
          header.number(kRows + 16 * row + 4 * column);
    }
  }
  return out;
}

// Largest distance between the corners of the image under the two.
double corners_apart(const Eigen::Matrix4d &a, const Eigen::Matrix4d &b, const std::array<std::int64_t, 3> &size) {
  double apart = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    Eigen::Vector4d index(0, 0, 0, 1);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const bool far = (corner >> axis & 1) != 0;
      index[static_cast<Eigen::Index>(axis)] = far ? static_cast<double>(size[axis] - 1) : 0.0;
    }
    apart = std::max(apart, ((a - b) * index).norm());
  }
  return apart;
}

base::Result<void> nifti_failure(const fs::path &path, const std::string &what) {
  return base::failure(path.string() + ": " + what);
}

base::Result<void> read_nifti_size(const fs::path &path, const NiftiBytes &header, ImageHeader &out) {
  const auto dimensions = header.at<std::int16_t>(kDimensions);
  std::vector<double> sizes;
  for (std::size_t axis = 1; axis <= static_cast<std::size_t>(std::clamp<int>(dimensions, 0, 7)); ++axis) {
    sizes.push_back(header.at<std::int16_t>(kDimensions + 2 * axis));
  }
  return check_shape(path, sizes).map([&out](const auto &shape) { out.size = shape; });
}

base::Result<void> place_nifti(const fs::path &path, const NiftiBytes &header, ImageHeader &out) {
  constexpr int kMetre = 1, kMicrometre = 3; // 2: mm
  const int unit = header.at<unsigned char>(kUnits) & 7;
  if (unit > kMicrometre) {
    return nifti_failure(path, "xyzt_units = " + std::to_string(unit) + ": is not a unit of length");
  }
  if (unit == 0) {
    out.notes.push_back(path.string() + ": its unit is not stated (xyzt_units): mm is assumed");
  }
  const double scale = unit == kMetre ? 1000.0 : unit == kMicrometre ? 0.001 : 1.0;
  const auto qform_code = header.at<std::int16_t>(kQformCode);
  const auto sform_code = header.at<std::int16_t>(kSformCode);
  if (qform_code <= 0 && sform_code <= 0) {
    return nifti_failure(path, "states no orientation (qform_code and sform_code are both 0)");
  }
  const Eigen::Matrix4d qform = qform_of(header);
  const Eigen::Matrix4d sform = sform_of(header);
  out.T_ras_index = sform_code > 0 ? sform : qform;
  out.T_ras_index.topRows<3>() *= scale;
  if (qform_code > 0 && sform_code > 0) {
    const double apart = scale * corners_apart(qform, sform, out.size);
    const double diagonal = corners_apart(out.T_ras_index, Eigen::Matrix4d::Zero(), out.size);
    if (!(apart <= kPlacementTolerance_mm * std::max(1.0, diagonal / 100.0))) {
      char text[32];
      (void)std::snprintf(text, sizeof text, "%.2f", apart);
      return nifti_failure(path, "its sform is sheared or contradicts its qform: a corner of the image would lie " +
                                     std::string(text) + " mm apart; resample the image to one of them");
    }
  }
  return {};
}

} // namespace

base::Result<ImageHeader> read_nifti_header(const fs::path &path) {
  const auto header = NiftiBytes::read(path);
  if (!header || header->text(kMagic, 4) != std::string_view("n+1\0", 4)) {
    return base::failure(path.string() + ": is not a NIfTI-1 image in one file (.nii, .nii.gz)");
  }
  ImageHeader out;
  const auto placed = read_nifti_size(path, *header, out).and_then([&] { return place_nifti(path, *header, out); });
  if (!placed) {
    return tl::unexpected(placed.error());
  }
  const double start = header->number(kVoxelsStart);
  if (!(start >= static_cast<double>(kHeaderBytes)) || start > 1e9) {
    return base::failure(path.string() + ": vox_offset = " + std::to_string(start) + ": lies within the header");
  }
  const auto values = static_cast<std::uint64_t>(out.size[0] * out.size[1] * out.size[2]);
  const auto bits = header->at<std::int16_t>(kBitsPerVoxel);
  if (bits < 1) {
    return base::failure(path.string() + ": bitpix = " + std::to_string(bits) + ": must be positive");
  }
  // Compressed data begin with the header.
  const std::uint64_t needed = (values * static_cast<std::uint64_t>(bits) + 7) / 8 + static_cast<std::uint64_t>(start);
  return check_whole({path, 0, header->compressed()}, needed).map([&] { return out; });
}

} // namespace bregma::casefile
