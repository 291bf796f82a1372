// Inside casefile/volumes only: what ITK hands over, before it is ours.
#pragma once

#include <itkImage.h>

#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

using ItkVolume = itk::Image<float, 3>;

// The even, untilted stack of slices of one DICOM series in the folder, in LPS as ITK has it.
[[nodiscard]] Result<ItkVolume::Pointer> read_dicom_series(const std::filesystem::path &folder,
                                                           const std::string &series);

// A number as a message shows it.
[[nodiscard]] std::string shown(double value, int digits);

} // namespace bregma::casefile
