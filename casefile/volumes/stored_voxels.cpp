// Voxels in a row: numbers of one type, in either byte order, plain or compressed.
#include <algorithm>
#include <bit>
#include <cstring>

#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {
namespace {

template <class Number> Number number_at(const char *bytes, bool swap) {
  std::array<char, sizeof(Number)> copy{};
  std::copy_n(bytes, sizeof(Number), copy.begin());
  if (swap) {
    std::reverse(copy.begin(), copy.end());
  }
  Number value{};
  std::memcpy(&value, copy.data(), sizeof value);
  return value;
}

// Calls visit with a number of the type.
template <class Visit> auto with_type(VoxelType type, const Visit &visit) {
  switch (type) {
  case VoxelType::kInt8:
    return visit(std::int8_t{});
  case VoxelType::kUint8:
    return visit(std::uint8_t{});
  case VoxelType::kInt16:
    return visit(std::int16_t{});
  case VoxelType::kUint16:
    return visit(std::uint16_t{});
  case VoxelType::kInt32:
    return visit(std::int32_t{});
  case VoxelType::kUint32:
    return visit(std::uint32_t{});
  case VoxelType::kInt64:
    return visit(std::int64_t{});
  case VoxelType::kUint64:
    return visit(std::uint64_t{});
  case VoxelType::kFloat32:
    return visit(float{});
  case VoxelType::kFloat64:
    break;
  }
  return visit(double{});
}

std::uint64_t bytes_of(VoxelType type) {
  return with_type(type, [](auto number) { return std::uint64_t{sizeof number}; });
}

} // namespace

base::Result<void> check_whole(const StoredVoxels &voxels, const std::filesystem::path &header_file,
                               ImageHeader &header) {
  const auto count = static_cast<std::uint64_t>(header.size[0] * header.size[1] * header.size[2]);
  return check_whole(voxels.data, count * bytes_of(voxels.type), header_file, header);
}

base::Result<std::vector<float>> read_stored_voxels(const StoredVoxels &voxels, std::uint64_t count) {
  std::vector<char> bytes;
  if (auto whole = check_whole(voxels.data, count * bytes_of(voxels.type), &bytes); !whole) {
    return tl::unexpected(whole.error());
  }
  const bool swap = voxels.big_endian == (std::endian::native == std::endian::little);
  std::vector<float> out(count);
  with_type(voxels.type, [&](auto type) {
    using Number = decltype(type);
    for (std::uint64_t i = 0; i < count; ++i) {
      const auto stored = static_cast<double>(number_at<Number>(bytes.data() + i * sizeof(Number), swap));
      out[i] = static_cast<float>(voxels.slope * stored + voxels.intercept);
    }
  });
  return out;
}

} // namespace bregma::casefile
