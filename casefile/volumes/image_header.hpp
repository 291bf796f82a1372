// Private to casefile/volumes: what the header of an image file states, read by our own code.
//
// The library that reads the voxels is not trusted with three questions: whether the file is whole, where its voxels
// lie, and what the file leaves open. ITK reads a file that was cut as if it were whole, takes a left-anterior-superior
// NRRD for another frame, and scales a NIfTI in metres only in part. The placement that is used is the one from here.
// NIfTI-2 and FreeSurfer's MGH are not read by Debian's ITK, so the voxels of NIfTI and MGH are read here as well.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "base/result.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

// Data of an image within a file.
struct StoredData {
  std::filesystem::path file;
  std::uint64_t begin = 0;   // bytes of the file before them
  bool compressed = false;   // zlib or gzip
  std::uint64_t skipped = 0; // bytes before the first voxel, after inflating where they are compressed
};

enum class VoxelType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kInt64, kUint64, kFloat32, kFloat64 };

// Voxels that our own code reads. The value of a voxel is slope times the stored number, plus the intercept.
struct StoredVoxels {
  StoredData data;
  VoxelType type = VoxelType::kUint8;
  bool big_endian = false;
  double slope = 1.0, intercept = 0.0;
};

struct ImageHeader {
  std::array<std::int64_t, 3> size{};                        // voxels along the stored axes, the first runs fastest
  Eigen::Matrix4d T_ras_index = Eigen::Matrix4d::Identity(); // index of a stored voxel to RAS, mm
  bool space_stated = true;
  std::vector<std::string> notes;     // what is not stated and was assumed
  std::optional<StoredVoxels> voxels; // of NIfTI and MGH; those of the others are read by ITK
  // Least length of the file with this header; 0: not known, since the voxels are compressed, text, or in another file.
  std::uint64_t least_bytes = 0;
  bool tags_follow = false; // anything may be behind the voxels
};

// By the content: an extension may be written in any case, or be missing. Only the data of a pair (.img) are found by
// their name.
enum class ImageFormat { kUnknown, kNifti, kMgh, kNrrd, kMeta, kDicom };
[[nodiscard]] ImageFormat image_format_of(const std::filesystem::path &path);
[[nodiscard]] base::Result<ImageHeader> read_image_header(const std::filesystem::path &path, ImageFormat format,
                                                          std::optional<Space> space);

// Each refuses a header that it does not understand, and a file that is not whole: fewer bytes than the header asks
// for, or compressed data that end early or do not match their checksum. space: of a file that does not state its own.
[[nodiscard]] base::Result<ImageHeader> read_nrrd_header(const std::filesystem::path &path, std::optional<Space> space);
[[nodiscard]] base::Result<ImageHeader> read_meta_header(const std::filesystem::path &path, std::optional<Space> space);
// NIfTI-1 and NIfTI-2, in one file or as a pair (.hdr and .img, of which either may be given), plain or gzip.
[[nodiscard]] base::Result<ImageHeader> read_nifti_header(const std::filesystem::path &path);
// .mgh, or .mgz with gzip.
[[nodiscard]] base::Result<ImageHeader> read_mgh_header(const std::filesystem::path &path);

// In the order of the file. Refuses a file that is not whole.
[[nodiscard]] base::Result<std::vector<float>> read_stored_voxels(const StoredVoxels &voxels, std::uint64_t count);

// The three sizes of a volume. Refuses fewer axes, an empty image, more axes with more than one voxel, and more than
// kMaxVoxels.
[[nodiscard]] base::Result<std::array<std::int64_t, 3>> check_shape(const std::filesystem::path &path,
                                                                    const std::vector<double> &sizes);

// The bytes of the voxels are there. keep: receives them. The number of bytes behind them.
[[nodiscard]] base::Result<std::uint64_t> check_whole(const StoredData &data, std::uint64_t needed_bytes,
                                                      std::vector<char> *keep = nullptr);
// The same; sets least_bytes of the header, which is in this file. Refuses a slice and more behind the voxels: the
// header is that of another image. Fewer bytes are noted.
[[nodiscard]] base::Result<void> check_whole(const StoredData &data, std::uint64_t needed_bytes,
                                             const std::filesystem::path &header_file, ImageHeader &header);
[[nodiscard]] base::Result<void> check_whole(const StoredVoxels &voxels, const std::filesystem::path &header_file,
                                             ImageHeader &header);

// The first bytes of a file, inflated if it is compressed with gzip; fewer if it is shorter.
struct FileHead {
  std::string bytes;
  bool compressed = false;
};
[[nodiscard]] FileHead read_file_head(const std::filesystem::path &path, std::size_t bytes);

// The lines of a text header up to one that ends it, at most 1 MiB, without their line ends.
struct TextHeader {
  std::vector<std::string> lines;
  std::uint64_t bytes = 0; // with the line that ends it
};
// ends: whether this line is the last one.
[[nodiscard]] base::Result<TextHeader> read_text_header(const std::filesystem::path &path,
                                                        bool (*ends)(std::string_view line));

// Numbers between blanks, commas and brackets; empty if another text is among them.
[[nodiscard]] std::vector<double> header_numbers(std::string_view text);

} // namespace bregma::casefile
