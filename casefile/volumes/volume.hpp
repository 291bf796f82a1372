// Images of a case: voxels on a regular grid, with the map from voxel index to Image (RAS, mm).
//
// Files: NIfTI-1 and -2, also as a pair, MGH, NRRD, MetaImage, a folder with a DICOM series, or an enhanced multi-frame
// DICOM file. ITK reads the voxels of the last four; where they lie, and whether the file is whole, our own code finds
// out (image_header.hpp). Positions are converted to RAS once, here, and voxels are reordered to the nearest axes (i
// towards the right, j anterior, k superior). Nothing downstream depends on how a scanner or converter stored the
// image. Every problem is an Error that names the file; nothing here throws. Not for a loop: reads block and allocate.
// Functions are safe to call from any thread, on different files at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "algorithms/image/grid.hpp"
#include "base/result.hpp"
#include "casefile/markups.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

using Volume = image::Image<float, 3>;             // intensities; always finite
using LabelVolume = image::Image<std::int16_t, 3>; // region numbers; 0 is the background

struct VolumeOptions {
  std::string series = {};                   // UID of a DICOM series, where a folder holds several
  std::optional<Space> space = std::nullopt; // of a file that does not state its own
};

// `path` is a file or a folder with DICOM slices. Refused: no file, no such format, a file that is not whole, no
// voxels, more than kMaxVoxels, more or fewer than three dimensions, voxels that are not finite, a singular or sheared
// grid, a DICOM series with missing or overlapping slices, several series without a choice. A DICOM series with uneven
// gaps or a tilted gantry is resampled.
//
// notes: receives what the file does not state and was assumed, what was left out, and what was resampled. Without it
// (nullptr) a file that does not state its space, or must be resampled, is refused.
inline constexpr std::int64_t kMaxVoxels = std::int64_t{1} << 30;
[[nodiscard]] base::Result<Volume> read_volume(const std::filesystem::path &path, const VolumeOptions &options = {},
                                               Notes *notes = nullptr);

// False for a file that is read only with an assumption, or an option, about its space.
[[nodiscard]] bool states_its_space(const std::filesystem::path &path);

// As read_volume; a voxel that is not a whole number of 16 bits is refused.
[[nodiscard]] base::Result<LabelVolume> read_labels(const std::filesystem::path &path,
                                                    const VolumeOptions &options = {}, Notes *notes = nullptr);

// NIfTI (.nii, .nii.gz), NRRD (.nrrd) or MetaImage (.mha), by the extension.
[[nodiscard]] base::Result<void> write_volume(const std::filesystem::path &path, const Volume &volume);

} // namespace bregma::casefile
