// Whether a distortion field may be applied to an image: the same answer for `mri correct` and `mri register`.
// And whether an image of a phantom may give one.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "casefile/volumes/displacement_file.hpp"
#include "casefile/volumes/scan_header.hpp"

namespace bregma::cli {

// What the operator accepts.
struct FieldConsent {
  bool not_corrected = false; // an image that does not state it was not corrected by the vendor
  bool other_scanner = false;
  bool expired = false;
};

// Refused: a field that has expired.
[[nodiscard]] base::Result<void> check_date(const std::string &field_file, const casefile::FieldHeader &field,
                                            const FieldConsent &consent);

// The patient position that the image states, or an empty text. Refused: a field that has expired, an image that the
// vendor has corrected or that does not state it, a mosaic, another modality or scanner. `series`: UID in a folder with
// several.
[[nodiscard]] base::Result<std::string> check_field_use(const std::string &field_file,
                                                        const casefile::FieldHeader &field, const std::string &image,
                                                        const std::string &series, const FieldConsent &consent);

// Of the image of a phantom: the header where it is DICOM. Refused: MR that the vendor has corrected, which does not
// show the scanner's distortion. A note where it does not state this.
[[nodiscard]] base::Result<std::optional<casefile::ScanHeader>>
check_phantom_image(const std::string &image, const std::string &series, std::vector<std::string> &notes);

// The images of one registration. Refused, as far as they are DICOM: another modality than MR, another patient position
// than stated, images of two scanners, and images of which the vendor has corrected some.
[[nodiscard]] base::Result<void> check_coil_images(const std::vector<std::string> &images,
                                                   const std::string &patient_position);

} // namespace bregma::cli
