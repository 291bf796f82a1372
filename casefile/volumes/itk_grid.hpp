// Inside casefile/volumes only: what ITK hands over, before it is ours.
#pragma once

#include <itkImage.h>
#include <itkImageIOBase.h>

#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

using ItkVolume = itk::Image<float, 3>;

// The even, untilted stack of slices of one DICOM series in the folder, in LPS as ITK has it.
[[nodiscard]] base::Result<ItkVolume::Pointer> read_dicom_series(const std::filesystem::path &folder,
                                                                 const std::string &series);

// What the library that reads NIfTI lets pass: a file that ends early (it would give zeros), a header without extent.
[[nodiscard]] base::Result<void> check_nifti_size(const std::filesystem::path &path, const itk::ImageIOBase &io);

// A NIfTI file may carry two matrices, or none; refused where it is not certain where the image lies.
[[nodiscard]] base::Result<void> check_nifti_placement(const std::filesystem::path &path, const itk::ImageIOBase &io,
                                                       const ItkVolume &image);

[[nodiscard]] Eigen::Matrix4d ras_from_index(const ItkVolume &image);

// "path: what"
[[nodiscard]] std::string file_error(const std::filesystem::path &path, const std::string &what);

// A number as a message shows it.
[[nodiscard]] std::string shown(double value, int digits);

} // namespace bregma::casefile
