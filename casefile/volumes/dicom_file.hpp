// Private to casefile/volumes: the structure of a DICOM file, read by our own code.
//
// GDCM reads a file that was cut as if it were whole, and Debian's build of it ends the process on some damaged ones.
// So every file is walked before GDCM sees it: the elements of its data set must fill it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "base/result.hpp"

namespace bregma::casefile {

// What the functional groups of a multi-frame file state about a frame (part 3, C.7.6.16). Empty where they do not.
struct DicomFrame {
  std::optional<Eigen::Vector3d> position_mm;             // LPS, centre of the first pixel
  std::optional<Eigen::Matrix<double, 6, 1>> orientation; // of row and column
  std::optional<Eigen::Vector2d> spacing_mm;              // between rows, between columns
  std::optional<double> slope, intercept;                 // of the stored values
};

struct DicomFile {
  bool has_pixels = false;
  bool compressed = false;        // pixels in fragments
  std::uint64_t pixel_bytes = 0;  // of pixels that are not compressed
  std::uint64_t fragments = 0;    // of compressed pixels
  std::uint64_t frame_count = 1;  // as stated
  std::vector<DicomFrame> frames; // of the functional groups; empty without them
  std::string series;             // its UID
  // Empty where they are not stated.
  std::string patient_name, patient_id, frame_of_reference;
  std::optional<double> instance, images_in_acquisition;
  // Of the image; 1 if they are not stated.
  std::uint64_t rows = 1, columns = 1, samples = 1, bits_allocated = 8;
};

// False for a file without the mark "DICM" of DICOM part 10.
[[nodiscard]] bool is_dicom_file(const std::filesystem::path &file);

// Refuses a file that is not whole: an element beyond its end, a sequence without its end, fewer pixels than stated,
// or a row of them and more too many. Nothing but the headers of the elements, and what DicomFile holds, is read. A
// file without the mark is taken as a data set that begins with its first byte.
[[nodiscard]] base::Result<DicomFile> read_dicom_file(const std::filesystem::path &file);

// The numbers of a decimal string, "a\b\c", which may be padded; empty if a value is not a finite number.
[[nodiscard]] std::vector<double> decimal_numbers(std::string_view text);

} // namespace bregma::casefile
