// Private to casefile/volumes: what the header of an image file states, read by our own code.
//
// The library that reads the voxels is not trusted with three questions: whether the file is whole, where its voxels
// lie, and what the file leaves open. It reads a file that was cut as if it were whole, takes a left-anterior-superior
// NRRD for another frame, and scales a NIfTI in metres only in part. The placement that is used is the one from here.
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

struct ImageHeader {
  std::array<std::int64_t, 3> size{};                        // voxels along the stored axes, the first runs fastest
  Eigen::Matrix4d T_ras_index = Eigen::Matrix4d::Identity(); // index of a stored voxel to RAS, mm
  bool space_stated = true;
  std::vector<std::string> notes; // what is not stated and was assumed
};

// Each refuses a header that it does not understand, and a file that is not whole: fewer bytes than the header asks
// for, or compressed data that end early or do not match their checksum. space: of a file that does not state its own.
[[nodiscard]] base::Result<ImageHeader> read_nrrd_header(const std::filesystem::path &path, std::optional<Space> space);
[[nodiscard]] base::Result<ImageHeader> read_meta_header(const std::filesystem::path &path, std::optional<Space> space);
[[nodiscard]] base::Result<ImageHeader> read_nifti_header(const std::filesystem::path &path);

// The three sizes of a volume. Refuses fewer axes, an empty image, more axes with more than one voxel, and more than
// kMaxVoxels.
[[nodiscard]] base::Result<std::array<std::int64_t, 3>> check_shape(const std::filesystem::path &path,
                                                                    const std::vector<double> &sizes);

// Data of an image within a file.
struct StoredData {
  std::filesystem::path file;
  std::uint64_t begin = 0; // bytes before it
  bool compressed = false; // zlib or gzip
};
[[nodiscard]] base::Result<void> check_whole(const StoredData &data, std::uint64_t needed_bytes);

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
