// Images as a case needs them: voxels on a regular grid, with the map from voxel index to Image (RAS, mm).
//
// Read through ITK: NIfTI, NRRD, MetaImage, or a folder with a DICOM series. ITK's LPS is turned into RAS once, here,
// and voxels are put in the order nearest to it (i towards the right, j anterior, k superior), so that nothing
// downstream depends on how a scanner or converter stored the same image. Everything that is wrong with a file is an
// Error that names it; nothing here throws. Not for a loop: reads block and allocate. Functions are safe to call from
// any thread, on different files at a time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/result.hpp"

namespace bregma::casefile {

template <class Voxel> struct VoxelGrid {
  std::array<int, 3> size{};                                   // voxels along i, j, k; i runs fastest in memory
  Eigen::Matrix4d T_image_index = Eigen::Matrix4d::Identity(); // voxel centres (i, j, k, 1) to RAS, mm; never singular
  std::vector<Voxel> voxels;

  [[nodiscard]] std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(size[0]) +
           static_cast<std::size_t>(i);
  }
  [[nodiscard]] Voxel at(int i, int j, int k) const { return voxels[offset(i, j, k)]; }
  [[nodiscard]] Eigen::Vector3d point_mm(const Eigen::Vector3d &index) const {
    return T_image_index.topLeftCorner<3, 3>() * index + T_image_index.topRightCorner<3, 1>();
  }
  // Distance between neighbouring voxels along i, j, k, mm.
  [[nodiscard]] Eigen::Vector3d spacing_mm() const { return T_image_index.topLeftCorner<3, 3>().colwise().norm(); }
};

using Volume = VoxelGrid<float>;             // intensities; always finite
using LabelVolume = VoxelGrid<std::int16_t>; // region numbers; 0 is the background

// `path` is a file or a folder with DICOM slices; `series` chooses by series UID where a folder holds several (refused
// otherwise, naming them). Refused: no file, no such format, no voxels, more than kMaxVoxels, more or fewer than three
// dimensions, voxels that are not finite, a singular or sheared grid, a DICOM series with uneven gaps or a tilted
// gantry.
inline constexpr std::int64_t kMaxVoxels = std::int64_t{1} << 30;
[[nodiscard]] base::Result<Volume> read_volume(const std::filesystem::path &path, const std::string &series = {});

// As read_volume; a voxel that is not a whole number of 16 bits is refused.
[[nodiscard]] base::Result<LabelVolume> read_labels(const std::filesystem::path &path);

// NIfTI (.nii, .nii.gz), NRRD (.nrrd) or MetaImage (.mha), by the extension.
[[nodiscard]] base::Result<void> write_volume(const std::filesystem::path &path, const Volume &volume);

// Region number to name, from lines "number name [anything]" as the atlases of MRIcron have them.
[[nodiscard]] base::Result<std::map<int, std::string>> read_label_names(const std::filesystem::path &path);

} // namespace bregma::casefile
