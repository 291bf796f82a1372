// What the DICOM headers of a series state about its acquisition.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "base/result.hpp"

namespace bregma::casefile {

enum class VendorCorrection {
  kNotStated, // other vendors than Siemens do not state it in the image type
  kNone,      // ND
  kCorrected, // DIS2D: in the plane, or DIS3D: in space
};

struct ScanHeader {
  std::string modality;           // (0008,0060)
  std::string image_type;         // (0008,0008), values joined by backslashes
  std::string manufacturer;       // (0008,0070)
  std::string model;              // (0008,1090)
  std::string serial_number;      // (0018,1000)
  std::string series_description; // (0008,103e)
  std::string series_uid;         // (0020,000e)
  std::string patient_position;   // (0018,5100)
  std::string phase_encoding;     // (0018,1312): ROW or COL
  std::string acquisition_date;   // (0008,0022), YYYYMMDD
  double bandwidth_Hz = 0.0;      // (0018,0095) per acquired pixel; 0: not stated
  // Along the rows or the columns, LPS, either sign; none where phase_encoding or the orientation is not stated.
  std::optional<Eigen::Vector3d> read_out;
  // Field of view along the read-out over the samples acquired there (0018,1310); 0: not stated. An image that the
  // scanner has interpolated has smaller pixels.
  double read_out_pixel_mm = 0.0;

  [[nodiscard]] std::string scanner() const; // manufacturer, model, serial number: those that are stated
  [[nodiscard]] VendorCorrection vendor_correction() const;
  [[nodiscard]] bool shows_phase() const; // P or PHASE..., whose values wrap and cannot be interpolated
};

// A folder, which can only be that of a series, or a file with the mark of DICOM part 10.
[[nodiscard]] bool is_dicom(const std::filesystem::path &path);

// Of a DICOM image, or of all images of one series in a folder and the folders within; `series` is its UID, where there
// are several. Files without an image are passed over. Refused: no image, a file that is not whole, and images of one
// series that differ in series, modality, scanner, patient position, or in what the vendor has corrected.
[[nodiscard]] base::Result<ScanHeader> read_scan_header(const std::filesystem::path &path,
                                                        const std::string &series = {});

} // namespace bregma::casefile
