#include "clients/cli/mri/field_use.hpp"

#include <chrono>
#include <ctime>
#include <utility>

namespace bregma::cli {

namespace {

std::string today() {
  const std::time_t at = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc{};
  gmtime_r(&at, &utc);
  char text[16];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%d", &utc)};
}

std::string series_text(const std::string &image, const casefile::ScanHeader &header) {
  return image + ": the series \"" + header.series_description + "\" ";
}

base::Result<void> check_modality(const std::string &image, const casefile::ScanHeader &header) {
  return header.modality == "MR"
             ? base::Result<void>()
             : base::failure(series_text(image, header) + "has the modality \"" + header.modality + "\", not MR");
}

} // namespace

base::Result<void> check_date(const std::string &field_file, const casefile::FieldHeader &field,
                              const FieldConsent &consent) {
  return field.expires.empty() || field.expires >= today() || consent.expired
             ? base::Result<void>()
             : base::failure(field_file + ": expired on " + field.expires +
                             "; measure the scanner again, or accept it by --expired");
}

base::Result<std::string> check_field_use(const std::string &field_file, const casefile::FieldHeader &field,
                                          const std::string &image, const std::string &series_uid,
                                          const FieldConsent &consent) {
  if (auto valid = check_date(field_file, field, consent); !valid) {
    return tl::unexpected(valid.error());
  }
  if (!casefile::is_dicom(image)) {
    return consent.not_corrected
               ? base::Result<std::string>(std::string())
               : base::failure(image + ": does not state whether its distortion was corrected by the vendor; "
                                       "if it was not, say so by --not-corrected");
  }
  const auto header = casefile::read_scan_header(image, series_uid);
  if (!header) {
    return tl::unexpected(header.error());
  }
  if (auto mr = check_modality(image, *header); !mr) {
    return tl::unexpected(mr.error());
  }
  const std::string series = series_text(image, *header);
  if (header->shows_phase()) {
    return base::failure(series + "shows phases (image type " + header->image_type +
                         "), which cannot be interpolated; correct the magnitude");
  }
  switch (header->vendor_correction()) {
  case casefile::VendorCorrection::kCorrected:
    return base::failure(series + "was corrected by the vendor (image type " + header->image_type +
                         "); a second correction would distort it");
  case casefile::VendorCorrection::kNotStated:
    if (!consent.not_corrected) {
      return base::failure(series + "does not state whether the vendor has corrected it (image type \"" +
                           header->image_type +
                           "\", without ND, DIS2D and DIS3D); if it was not, say so by --not-corrected");
    }
    break;
  case casefile::VendorCorrection::kNone:
    break;
  }
  if (!field.scanner.empty() && header->scanner() != field.scanner && !consent.other_scanner) {
    return base::failure(series + "is of the scanner \"" + header->scanner() + "\", the field of \"" + field.scanner +
                         "\"; accept it by --other-scanner");
  }
  return header->patient_position;
}

base::Result<std::optional<casefile::ScanHeader>>
check_phantom_image(const std::string &image, const std::string &series_uid, std::vector<std::string> &notes) {
  if (!casefile::is_dicom(image)) {
    return std::optional<casefile::ScanHeader>();
  }
  auto header = casefile::read_scan_header(image, series_uid);
  if (!header) {
    return tl::unexpected(header.error());
  }
  if (header->modality == "MR" && header->vendor_correction() == casefile::VendorCorrection::kCorrected) {
    return base::failure(series_text(image, *header) + "was corrected by the vendor (image type " + header->image_type +
                         "): its control points do not show the scanner's distortion; scan without the correction");
  }
  if (header->modality == "MR" && header->vendor_correction() == casefile::VendorCorrection::kNotStated) {
    notes.push_back(series_text(image, *header) + "does not state whether the vendor has corrected it (image type \"" +
                    header->image_type + "\"): where it was, its control points do not show the scanner's distortion");
  }
  return std::optional(std::move(*header));
}

base::Result<void> check_coil_images(const std::vector<std::string> &images, const std::string &patient_position) {
  std::optional<casefile::ScanHeader> first;
  for (const std::string &image : images) {
    if (!casefile::is_dicom(image)) {
      continue;
    }
    auto header = casefile::read_scan_header(image);
    if (!header) {
      return tl::unexpected(header.error());
    }
    if (auto mr = check_modality(image, *header); !mr) {
      return mr;
    }
    if (!header->patient_position.empty() && header->patient_position != patient_position) {
      return base::failure(series_text(image, *header) + "has the patient position " + header->patient_position +
                           ", the list states " + patient_position);
    }
    if (first && header->scanner() != first->scanner()) {
      return base::failure(series_text(image, *header) + "is of the scanner \"" + header->scanner() +
                           "\", the first one of \"" + first->scanner() + "\"");
    }
    if (first && header->vendor_correction() != first->vendor_correction()) {
      return base::failure(
          series_text(image, *header) + "has the image type " + header->image_type + ", the first one " +
          first->image_type +
          ": the vendor has corrected one of them, and coils would not lie where the other shows them");
    }
    first = first ? std::move(first) : std::optional(std::move(*header));
  }
  return {};
}

} // namespace bregma::cli
