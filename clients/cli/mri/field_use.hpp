// Whether a distortion field may be applied to an image: the same answer for `mri correct` and `mri register`.
// And whether an image of a phantom may give one.
#pragma once

#include <string>

#include "base/result.hpp"
#include "casefile/volumes/displacement_file.hpp"

namespace bregma::cli {

// What the operator accepts.
struct FieldConsent {
  bool not_corrected = false; // an image that does not state it was not corrected by the vendor
  bool other_scanner = false;
  bool expired = false;
};

// The patient position that the image states, or an empty text. Refused: a field that has expired, an image that the
// vendor has corrected or that does not state it, another modality or scanner. `series`: UID in a folder with several.
[[nodiscard]] base::Result<std::string> check_field_use(const std::string &field_file,
                                                        const casefile::DisplacementField &field,
                                                        const std::string &image, const std::string &series,
                                                        const FieldConsent &consent);

// Refused: an image of a phantom in MR that the vendor has corrected, which does not show the scanner's distortion.
[[nodiscard]] base::Result<void> check_phantom_image(const std::string &image, const std::string &series);

} // namespace bregma::cli
