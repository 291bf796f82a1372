// A distortion field as files: displacements as an NRRD vector image, which ITK and Slicer read as a displacement field
// or grid transform, and beside it a scalar image with the stated error (NAME.error.nrrd).
//
// In resampling direction: the corrected image takes its value at p from the distorted one at p + displacement(p). In
// memory RAS, in the files LPS; mm. Errors are negative where the field extrapolates. The header states under "bregma
// ..." keys what the field belongs to; other programs keep or ignore them.
//
// A registration of images writes a field without errors, which correction of images does not accept.
//
// Reader and writer are our own. Only files of this writer are read; ITK's reader is compared in the tests. Every
// problem is an Error that names the file and the field.
#pragma once

#include <filesystem>
#include <string>

#include <Eigen/Core>

#include "algorithms/image/grid.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// What a scanner's field belongs to.
struct FieldHeader {
  std::string scanner; // may be empty
  std::string protocol;
  std::string patient_position = "HFS"; // of the images that the field was measured with
  std::string made;                     // date, YYYY-MM-DD
  std::string expires;                  // last day of use, YYYY-MM-DD; empty: no limit
};

// What displaces: all that displaced one scan, or one of its parts (mri/scan_fields.hpp).
enum class FieldPart { kOneReadOut, kGradients, kB0 };

struct DisplacementField : FieldHeader {
  image::Image<Eigen::Vector3f, 3> displacement_mm;
  image::Image<float, 3> signed_error_95_mm; // on a grid of its own; without voxels: not known, and no file is written
  double max_error_95_mm = 0.0;              // above it the field is unknown
  FieldPart part = FieldPart::kOneReadOut;
  // RAS: movement by B0 in the scan to which the displacements belong (mri/separation.hpp); zero: not stated, or none.
  Eigen::Vector3d mm_per_Hz = Eigen::Vector3d::Zero();
  std::string gradients; // of a part of B0: field_mark() of that of the gradients
};
// Differs for fields with other displacements.
[[nodiscard]] std::string field_mark(const DisplacementField &field);

// The path must end in .nrrd. Texts are one line each. Files are replaced, each as a whole; the reader refuses errors
// beside a field that they were not written with.
[[nodiscard]] base::Result<void> write_displacement_field(const std::filesystem::path &path,
                                                          const DisplacementField &field);
[[nodiscard]] base::Result<DisplacementField> read_displacement_field(const std::filesystem::path &path);

// The file of the errors of a field.
[[nodiscard]] std::filesystem::path error_file_of(const std::filesystem::path &path);

} // namespace bregma::casefile
