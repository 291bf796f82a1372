// The header of FreeSurfer's MGH file: "FsTutorial/MghFormat" of the FreeSurfer wiki. Big-endian, 284 bytes, then the
// voxels; what follows them (times of the sequence, tags) is not used.
#include <algorithm>
#include <array>
#include <cstring>

#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {
namespace {

constexpr std::size_t kHeaderBytes = 284;
// Offsets of the fields.
constexpr std::size_t kSizes = 4, kFrames = 16, kType = 20, kGoodRas = 28, kSpacing = 30, kDirections = 42,
                      kCentre = 78;

template <class T> T big_endian_at(const std::string &bytes, std::size_t offset) {
  std::array<char, sizeof(T)> copy{};
  std::reverse_copy(bytes.begin() + static_cast<std::ptrdiff_t>(offset),
                    bytes.begin() + static_cast<std::ptrdiff_t>(offset + sizeof(T)), copy.begin());
  T value{};
  std::memcpy(&value, copy.data(), sizeof value);
  return value;
}

Eigen::Vector3d vector_at(const std::string &bytes, std::size_t offset) {
  Eigen::Vector3d out;
  for (std::size_t i = 0; i < 3; ++i) {
    out[static_cast<Eigen::Index>(i)] = static_cast<double>(big_endian_at<float>(bytes, offset + 4 * i));
  }
  return out;
}

std::optional<VoxelType> mgh_voxel_type(std::int32_t type) {
  switch (type) {
  case 0:
    return VoxelType::kUint8;
  case 1:
    return VoxelType::kInt32;
  case 3:
    return VoxelType::kFloat32;
  case 4:
    return VoxelType::kInt16;
  case 10:
    return VoxelType::kUint16;
  default:
    return std::nullopt;
  }
}

} // namespace

base::Result<ImageHeader> read_mgh_header(const std::filesystem::path &path) {
  const auto refuse = [&path](const std::string &what) { return base::failure(path.string() + ": " + what); };
  const FileHead head = read_file_head(path, kHeaderBytes);
  const std::string &bytes = head.bytes;
  if (bytes.size() < kHeaderBytes || big_endian_at<std::int32_t>(bytes, 0) != 1) {
    return refuse(bytes.size() < kHeaderBytes ? "is not whole: its header has " + std::to_string(bytes.size()) +
                                                    " of " + std::to_string(kHeaderBytes) + " bytes"
                                              : "is not an MGH image of version 1 (.mgh, .mgz)");
  }
  std::vector<double> sizes;
  for (std::size_t axis = 0; axis < 4; ++axis) { // the fourth are the frames
    sizes.push_back(big_endian_at<std::int32_t>(bytes, kSizes + 4 * axis));
  }
  static_assert(kFrames == kSizes + 12);
  const auto size = check_shape(path, sizes);
  if (!size) {
    return tl::unexpected(size.error());
  }
  const auto stored = big_endian_at<std::int32_t>(bytes, kType);
  const auto type = mgh_voxel_type(stored);
  if (!type) {
    return refuse("type = " + std::to_string(stored) +
                  ": is not read; read are 0 (uchar), 1 (int), 3 (float), 4 (short), 10 (ushort)");
  }
  if (big_endian_at<std::int16_t>(bytes, kGoodRas) != 1) {
    return refuse(
        "states no orientation (goodRASFlag = " + std::to_string(big_endian_at<std::int16_t>(bytes, kGoodRas)) + ")");
  }
  // Columns are the directions of the axes; the centre is the voxel of half the size, counted from 0.
  Eigen::Matrix3d axes;
  const Eigen::Vector3d spacing = vector_at(bytes, kSpacing);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto column = static_cast<Eigen::Index>(axis);
    axes.col(column) = spacing[column] * vector_at(bytes, kDirections + 12 * axis);
  }
  const Eigen::Vector3d half(0.5 * sizes[0], 0.5 * sizes[1], 0.5 * sizes[2]);
  ImageHeader out;
  out.size = *size;
  out.tags_follow = true;
  out.T_ras_index.topLeftCorner<3, 3>() = axes;
  out.T_ras_index.topRightCorner<3, 1>() = vector_at(bytes, kCentre) - axes * half;
  out.voxels = StoredVoxels{{path, 0, head.compressed, kHeaderBytes}, *type, true};
  return check_whole(*out.voxels, path, out).map([&] {
    out.notes.clear(); // the parameters of the scan may follow the voxels
    return out;
  });
}

} // namespace bregma::casefile
