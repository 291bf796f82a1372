// The header of a NIfTI file: nifti1.h of the NIfTI-1.1 standard, nifti2.h of NIfTI-2; in one file, or as a pair.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <system_error>

#include <Eigen/Geometry>

#include "base/text.hpp"
#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

constexpr double kPlacementTolerance_mm = 0.01; // between the file's two matrices, at a corner of the image

// The two versions hold the same fields, with other types and at other places.
struct NiftiFields {
  std::string magic;
  double dimensions = 0.0; // as stated; sizes has at most seven
  std::vector<double> sizes;
  int type = 0, bits = 0;
  std::array<double, 4> pixel_sizes{}; // the first is the sign of the third axis, of the qform
  double voxels_start = 0.0, slope = 0.0, intercept = 0.0;
  int unit = 0, qform_code = 0, sform_code = 0;
  Eigen::Vector3d quaternion = Eigen::Vector3d::Zero(), quaternion_offset = Eigen::Vector3d::Zero();
  Eigen::Matrix<double, 3, 4> rows = Eigen::Matrix<double, 3, 4>::Zero();
  bool big_endian = false;
};

// The offsets of one version.
struct NiftiLayout {
  std::size_t magic, magic_length, sizes, type, pixel_sizes, voxels_start, slope, unit, qform_code, quaternion, rows;
};
constexpr std::size_t kBytes1 = 348, kBytes2 = 540;
constexpr NiftiLayout kLayout1{344, 4, 40, 70, 76, 108, 112, 123, 252, 256, 280};
constexpr NiftiLayout kLayout2{4, 8, 16, 12, 104, 168, 176, 500, 344, 352, 400};

class NiftiBytes {
public:
  NiftiBytes(std::string_view bytes, bool swapped) : bytes_(bytes), swapped_(swapped) {}

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

  // Code: the type of qform_code; Size: of sizes; Real: of the other numbers.
  template <class Code, class Size, class Real> [[nodiscard]] NiftiFields fields(const NiftiLayout &at) const {
    NiftiFields out;
    out.magic = bytes_.substr(at.magic, at.magic_length);
    const auto dimensions = this->at<Size>(at.sizes);
    out.dimensions = static_cast<double>(dimensions);
    for (std::size_t axis = 1; axis <= static_cast<std::size_t>(std::clamp<Size>(dimensions, 0, 7)); ++axis) {
      out.sizes.push_back(static_cast<double>(this->at<Size>(at.sizes + sizeof(Size) * axis)));
    }
    out.type = this->at<std::int16_t>(at.type);
    out.bits = this->at<std::int16_t>(at.type + 2);
    const auto real = [this](std::size_t offset, std::size_t i) {
      return static_cast<double>(this->at<Real>(offset + sizeof(Real) * i));
    };
    for (std::size_t i = 0; i < 4; ++i) {
      out.pixel_sizes[i] = real(at.pixel_sizes, i);
    }
    out.slope = real(at.slope, 0);
    out.intercept = real(at.slope, 1);
    out.qform_code = this->at<Code>(at.qform_code);
    out.sform_code = this->at<Code>(at.qform_code + sizeof(Code));
    for (std::size_t i = 0; i < 3; ++i) {
      out.quaternion[static_cast<Eigen::Index>(i)] = real(at.quaternion, i);
      out.quaternion_offset[static_cast<Eigen::Index>(i)] = real(at.quaternion, 3 + i);
      for (std::size_t column = 0; column < 4; ++column) {
        out.rows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(column)) = real(at.rows, 4 * i + column);
      }
    }
    out.big_endian = swapped_;
    return out;
  }

private:
  std::string_view bytes_;
  bool swapped_;
};

// Empty: not as long as a header, or not of a length that is known.
std::optional<NiftiFields> parse_nifti(std::string_view bytes) {
  static_assert(std::endian::native == std::endian::little);
  for (const bool swapped : {false, true}) {
    const NiftiBytes header(bytes, swapped);
    const std::int32_t length = bytes.size() >= 4 ? header.at<std::int32_t>(0) : 0;
    if (length == kBytes1 && bytes.size() >= kBytes1) {
      NiftiFields out = header.fields<std::int16_t, std::int16_t, float>(kLayout1);
      out.voxels_start = static_cast<double>(header.at<float>(kLayout1.voxels_start));
      out.unit = header.at<unsigned char>(kLayout1.unit);
      return out;
    }
    if (length == kBytes2 && bytes.size() >= kBytes2) {
      NiftiFields out = header.fields<std::int32_t, std::int64_t, double>(kLayout2);
      out.voxels_start = static_cast<double>(header.at<std::int64_t>(kLayout2.voxels_start));
      out.unit = header.at<std::int32_t>(kLayout2.unit);
      return out;
    }
  }
  return std::nullopt;
}

// Quaternion, offset and voxel size; the sign of the first pixel size is that of the third axis.
Eigen::Matrix4d qform_of(const NiftiFields &header) {
  const Eigen::Vector3d &v = header.quaternion;
  const double squared = v.squaredNorm();
  const Eigen::Quaterniond q = squared > 1.0 ? Eigen::Quaterniond(0.0, v.x(), v.y(), v.z()).normalized()
                                             : Eigen::Quaterniond(std::sqrt(1.0 - squared), v.x(), v.y(), v.z());
  const auto &size = header.pixel_sizes;
  const double third = size[0] < 0.0 ? -1.0 : 1.0;
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = q.toRotationMatrix() * Eigen::Vector3d(size[1], size[2], third * size[3]).asDiagonal();
  out.topRightCorner<3, 1>() = header.quaternion_offset;
  return out;
}

Eigen::Matrix4d sform_of(const NiftiFields &header) {
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topRows<3>() = header.rows;
  return out;
}

Eigen::Vector3d pixel_sizes_of(const NiftiFields &header) {
  return {header.pixel_sizes[1], header.pixel_sizes[2], header.pixel_sizes[3]};
}

std::string text_of_sizes(const Eigen::Vector3d &sizes) {
  char text[96];
  (void)std::snprintf(text, sizeof text, "%.4g x %.4g x %.4g", sizes.x(), sizes.y(), sizes.z());
  return text;
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

base::Result<void> place_nifti(const fs::path &path, const NiftiFields &header, ImageHeader &out) {
  constexpr int kMetre = 1, kMicrometre = 3; // 2: mm
  const int unit = header.unit & 7;
  if (unit > kMicrometre) {
    return nifti_failure(path, "xyzt_units = " + std::to_string(unit) + ": is not a unit of length");
  }
  if (unit == 0) {
    out.notes.push_back(path.string() + ": its unit is not stated (xyzt_units): mm is assumed");
  }
  const double scale = unit == kMetre ? 1000.0 : unit == kMicrometre ? 0.001 : 1.0;
  if (header.qform_code <= 0 && header.sform_code <= 0) {
    return nifti_failure(path, "states no orientation (qform_code and sform_code are both 0)");
  }
  constexpr double kRounding = 1e-3;
  if (header.qform_code > 0 && !(header.quaternion.squaredNorm() <= 1.0 + kRounding)) {
    return nifti_failure(path, "its qform is no rotation: quatern_b, c and d have a square of " +
                                   std::to_string(header.quaternion.squaredNorm()));
  }
  // nifti1.h asks for sizes above 0; programs take a negative one as its size, as 1, or as a mirror image.
  if (header.qform_code > 0 && header.sform_code <= 0 && !(pixel_sizes_of(header).array() > 0.0).all()) {
    return nifti_failure(path, "pixdim = " + text_of_sizes(pixel_sizes_of(header)) +
                                   ": a qform needs sizes of voxels above 0");
  }
  const Eigen::Matrix4d qform = qform_of(header);
  const Eigen::Matrix4d sform = sform_of(header);
  if (header.qform_code <= 0) {
    const Eigen::Vector3d stated = pixel_sizes_of(header).cwiseAbs();
    const Eigen::Vector3d used = sform.topLeftCorner<3, 3>().colwise().norm().transpose();
    if (!((stated - used).cwiseAbs().array() <= kRounding * used.array()).all()) {
      out.notes.push_back(path.string() + ": pixdim states voxels of " + text_of_sizes(stated) + ", its sform of " +
                          text_of_sizes(used) + ": the sform is used");
    }
  }
  out.T_ras_index = header.sform_code > 0 ? sform : qform;
  out.T_ras_index.topRows<3>() *= scale;
  if (header.qform_code > 0 && header.sform_code > 0) {
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

std::optional<VoxelType> nifti_voxel_type(int type) {
  switch (type) {
  case 2:
    return VoxelType::kUint8;
  case 4:
    return VoxelType::kInt16;
  case 8:
    return VoxelType::kInt32;
  case 16:
    return VoxelType::kFloat32;
  case 64:
    return VoxelType::kFloat64;
  case 256:
    return VoxelType::kInt8;
  case 512:
    return VoxelType::kUint16;
  case 768:
    return VoxelType::kUint32;
  case 1024:
    return VoxelType::kInt64;
  case 1280:
    return VoxelType::kUint64;
  default:
    return std::nullopt;
  }
}

int bits_of(VoxelType type) {
  switch (type) {
  case VoxelType::kInt8:
  case VoxelType::kUint8:
    return 8;
  case VoxelType::kInt16:
  case VoxelType::kUint16:
    return 16;
  case VoxelType::kInt32:
  case VoxelType::kUint32:
  case VoxelType::kFloat32:
    return 32;
  default:
    return 64;
  }
}

base::Result<void> read_voxel_type(const fs::path &path, const NiftiFields &header, StoredVoxels &out) {
  const auto type = nifti_voxel_type(header.type);
  if (!type) {
    return nifti_failure(path, "datatype = " + std::to_string(header.type) +
                                   ": is not read (complex, colour or unknown); a scalar image is needed");
  }
  if (header.bits != bits_of(*type)) {
    return nifti_failure(path, "bitpix = " + std::to_string(header.bits) + ": contradicts datatype " +
                                   std::to_string(header.type));
  }
  out.type = *type;
  out.big_endian = header.big_endian;
  if (std::isinf(header.slope)) {
    return nifti_failure(path, "scl_slope is not a finite number");
  }
  // A slope of 0, or NaN as some programs write, states that the numbers are not scaled.
  if (std::isfinite(header.slope) && header.slope != 0.0) {
    if (!std::isfinite(header.intercept)) {
      return nifti_failure(path, "scl_inter is not a finite number");
    }
    out.slope = header.slope;
    out.intercept = header.intercept;
  }
  return {};
}

// The other file of a pair; empty if there is none.
fs::path beside(const fs::path &file, std::initializer_list<const char *> extensions) {
  fs::path stem = file;
  if (base::lower(stem.extension().string()) == ".gz") {
    stem.replace_extension();
  }
  std::error_code ignored;
  for (const char *extension : extensions) {
    if (stem.replace_extension(extension); fs::is_regular_file(stem, ignored)) {
      return stem;
    }
  }
  return {};
}

base::Result<fs::path> header_file_of(const fs::path &path) {
  const std::string name = base::lower(path.filename().string());
  if (!name.ends_with(".img") && !name.ends_with(".img.gz")) {
    return path;
  }
  const fs::path header = beside(path, {".hdr", ".HDR", ".hdr.gz", ".HDR.GZ"});
  return header.empty() ? base::Result<fs::path>(base::failure(path.string() + ": holds voxels only, its header (.hdr) "
                                                                               "must be beside it"))
                        : header;
}

// Where the voxels are: behind the header, or in the other file of a pair.
base::Result<StoredData> data_of(const fs::path &file, const NiftiFields &header, bool compressed) {
  const bool single = header.magic.starts_with("n+");
  constexpr std::size_t kExtension = 4; // states whether the header is extended; always there in one file
  const double least = single ? static_cast<double>((header.magic[2] == '1' ? kBytes1 : kBytes2) + kExtension) : 0.0;
  if (!(header.voxels_start >= least) || header.voxels_start > 1e9 ||
      std::floor(header.voxels_start) != header.voxels_start) {
    return base::failure(file.string() + ": vox_offset = " + std::to_string(header.voxels_start) +
                         ": is not a place behind the header");
  }
  const auto start = static_cast<std::uint64_t>(header.voxels_start);
  if (single) { // compressed data begin with the header
    return StoredData{file, 0, compressed, start};
  }
  const fs::path data = beside(file, {".img", ".IMG", ".img.gz", ".IMG.GZ"});
  if (data.empty()) {
    return base::failure(file.string() + ": is the header of a pair, its voxels (.img) must be beside it");
  }
  return StoredData{data, 0, read_file_head(data, 1).compressed, start};
}

} // namespace

base::Result<ImageHeader> read_nifti_header(const fs::path &path) {
  const auto file = header_file_of(path);
  if (!file) {
    return tl::unexpected(file.error());
  }
  const FileHead head = read_file_head(*file, kBytes2);
  const auto header = parse_nifti(head.bytes);
  if (!header) {
    return base::failure(file->string() + ": is not a NIfTI image that is whole (.nii, .nii.gz, .hdr with .img)");
  }
  constexpr std::array<std::string_view, 4> kMagics{std::string_view("n+1\0", 4), std::string_view("ni1\0", 4),
                                                    std::string_view("n+2\0\r\n\032\n", 8),
                                                    std::string_view("ni2\0\r\n\032\n", 8)};
  if (std::find(kMagics.begin(), kMagics.end(), header->magic) == kMagics.end()) {
    return base::failure(file->string() + ": is an Analyze 7.5 header or a damaged NIfTI: Analyze does not state which "
                                          "side is left; convert it to NIfTI where its orientation is known");
  }
  if (!(header->dimensions >= 1.0 && header->dimensions <= 7.0)) {
    return base::failure(file->string() + ": dim[0] = " + std::to_string(std::llround(header->dimensions)) +
                         ": must be a number of axes from 1 to 7; the header is damaged");
  }
  const auto size = check_shape(*file, header->sizes);
  if (!size) {
    return tl::unexpected(size.error());
  }
  const auto data = data_of(*file, *header, head.compressed);
  if (!data) {
    return tl::unexpected(data.error());
  }
  ImageHeader out;
  out.size = *size;
  StoredVoxels voxels{*data};
  return place_nifti(*file, *header, out)
      .and_then([&] { return read_voxel_type(*file, *header, voxels); })
      .and_then([&] { return check_whole(voxels, *file, out); })
      .map([&] {
        out.voxels = voxels;
        return out;
      });
}

} // namespace bregma::casefile
