// Images of a case: voxels on a regular grid, with the map from voxel index to Image (RAS, mm).
//
// Images are read by ITK: NIfTI, NRRD, MetaImage, or a folder with a DICOM series. ITK's LPS is converted to RAS once,
// here, and voxels are reordered to the nearest axes (i towards the right, j anterior, k superior). Nothing downstream
// depends on how a scanner or converter stored the image. Every problem is an Error that names the file; nothing here
// throws. Not for a loop: reads block and allocate. Functions are safe to call from
// any thread, on different files at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>

#include "algorithms/image/grid.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

using Volume = image::Image<float, 3>;             // intensities; always finite
using LabelVolume = image::Image<std::int16_t, 3>; // region numbers; 0 is the background

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
