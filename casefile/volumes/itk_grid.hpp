// Private to casefile/volumes: data from ITK before conversion.
#pragma once

#include <itkImage.h>
#include <itkImageIOBase.h>

#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

using ItkVolume = itk::Image<float, 3>;

struct PlacedVolume {
  ItkVolume::Pointer voxels; // in the order of the file; its own grid is not used
  Eigen::Matrix4d T_ras_index = Eigen::Matrix4d::Identity();
  bool space_stated = true;
  std::vector<std::string> notes;
  bool resampled = false; // the last note says so
};

// The stack of slices of one DICOM series in the folder, resampled if it is unevenly spaced or tilted.
[[nodiscard]] base::Result<PlacedVolume> read_dicom_series(const std::filesystem::path &folder,
                                                           const std::string &series);

// An enhanced multi-frame file: its frames lie where its functional groups say, whatever their order in the file.
[[nodiscard]] base::Result<PlacedVolume> read_dicom_frames(const std::filesystem::path &file);

// "path: what"
[[nodiscard]] std::string file_error(const std::filesystem::path &path, const std::string &what);

// A number as text for messages.
[[nodiscard]] std::string shown(double value, int digits);

} // namespace bregma::casefile
