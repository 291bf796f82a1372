#include "clients/cli/mri/field_use.hpp"

#include <chrono>
#include <ctime>
#include <filesystem>
#include <system_error>

#include "casefile/volumes/scan_header.hpp"

namespace bregma::cli {

namespace {

std::string today() {
  const std::time_t at = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc{};
  gmtime_r(&at, &utc);
  char text[16];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%d", &utc)};
}

} // namespace

base::Result<std::string> check_field_use(const std::string &field_file, const casefile::DisplacementField &field,
                                          const std::string &image, const std::string &series_uid,
                                          const FieldConsent &consent) {
  if (!field.expires.empty() && field.expires < today() && !consent.expired) {
    return base::failure(field_file + ": expired on " + field.expires +
                         "; measure the scanner again, or accept it by --expired");
  }
  // A folder must be a DICOM series; a file may be one image of it, or another format that states nothing.
  std::error_code ignored;
  const bool folder = std::filesystem::is_directory(image, ignored);
  const auto header = casefile::read_scan_header(image, series_uid);
  if (!header && folder) {
    return tl::unexpected(header.error());
  }
  if (!header) {
    return consent.not_corrected
               ? base::Result<std::string>(std::string())
               : base::failure(image + ": does not state whether its distortion was corrected by the vendor; "
                                       "if it was not, say so by --not-corrected");
  }
  const std::string series = image + ": the series \"" + header->series_description + "\" ";
  if (header->modality != "MR") {
    return base::failure(series + "has the modality \"" + header->modality + "\", not MR");
  }
  if (header->vendor_corrected()) {
    return base::failure(series + "was corrected by the vendor (image type " + header->image_type +
                         "); a second correction would distort it");
  }
  if (!field.scanner.empty() && header->scanner() != field.scanner && !consent.other_scanner) {
    return base::failure(series + "is of the scanner \"" + header->scanner() + "\", the field of \"" + field.scanner +
                         "\"; accept it by --other-scanner");
  }
  return header->patient_position;
}

base::Result<void> check_phantom_image(const std::string &image, const std::string &series_uid) {
  const auto header = casefile::read_scan_header(image, series_uid);
  if (header && header->modality == "MR" && header->vendor_corrected()) {
    return base::failure(image + ": the series \"" + header->series_description +
                         "\" was corrected by the vendor (image type " + header->image_type +
                         "): its control points do not show the scanner's distortion; scan without the correction");
  }
  return {};
}

} // namespace bregma::cli
