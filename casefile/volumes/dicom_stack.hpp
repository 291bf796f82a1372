// Private to casefile/volumes: slices of DICOM, each with its own position, as a volume. Slices that are stacked at
// equal gaps along their common normal are one; others are resampled to one, or refused. Other tags about "slice
// spacing" are not used.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Eigenvalues> // before ITK brings its own, older copy

#include "base/result.hpp"
#include "casefile/volumes/itk_grid.hpp"

namespace bregma::casefile {

// One slice of a series, or one frame of a multi-frame file.
struct DicomSlice {
  std::string file;
  std::string name; // of the slice for messages: the file's without its folder, or "frame 3"
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero(); // LPS, centre of the first pixel
  Eigen::Vector3d row = Eigen::Vector3d::Zero();         // direction in which columns count up
  Eigen::Vector3d column = Eigen::Vector3d::Zero();
  Eigen::Vector2d spacing_mm = Eigen::Vector2d::Zero(); // along row, along column
  std::array<std::int64_t, 2> size{};
  std::size_t frame = 0; // of its file
  double depth_mm = 0.0; // along the common normal
};

// "FOLDER: the DICOM series WHAT"
[[nodiscard]] std::string series_error(const std::filesystem::path &folder, const std::string &what);

// A slice with a position and an orientation that is one.
[[nodiscard]] base::Result<void> check_slice(const std::filesystem::path &folder, const DicomSlice &slice);

struct DicomStack {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double gap_mm = 0.0;
  std::string uneven; // what must be resampled; empty: nothing
};

// Sorts the slices along their common normal. Refused: fewer than three, too many voxels, slices of different size,
// spacing or orientation, slices that are missing, in the same place, or too far apart.
[[nodiscard]] base::Result<DicomStack> stack_of(const std::filesystem::path &folder, std::vector<DicomSlice> &slices);

// image: the voxels of the sorted slices. In its own grid, or resampled to an even and straight one, which its last
// note says.
[[nodiscard]] PlacedVolume placed(const std::filesystem::path &folder, const std::vector<DicomSlice> &slices,
                                  const DicomStack &stack, ItkVolume::Pointer image, std::vector<std::string> notes);

} // namespace bregma::casefile
