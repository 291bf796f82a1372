// Private to casefile/volumes: data from ITK before conversion.
#pragma once

#include <itkImage.h>
#include <itkImageIOBase.h>

#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

using ItkVolume = itk::Image<float, 3>;

// The evenly spaced, untilted stack of slices of one DICOM series in the folder, in LPS as in ITK.
[[nodiscard]] base::Result<ItkVolume::Pointer> read_dicom_series(const std::filesystem::path &folder,
                                                                 const std::string &series);

// Errors that the NIfTI library does not detect: a truncated file (it would return zeros), a header without extent.
[[nodiscard]] base::Result<void> check_nifti_size(const std::filesystem::path &path, const itk::ImageIOBase &io);

// A NIfTI file may contain two matrices, or none; refused where the image's position is ambiguous.
[[nodiscard]] base::Result<void> check_nifti_placement(const std::filesystem::path &path, const itk::ImageIOBase &io,
                                                       const ItkVolume &image);

[[nodiscard]] Eigen::Matrix4d ras_from_index(const ItkVolume &image);

// "path: what"
[[nodiscard]] std::string file_error(const std::filesystem::path &path, const std::string &what);

// A number as text for messages.
[[nodiscard]] std::string shown(double value, int digits);

} // namespace bregma::casefile
