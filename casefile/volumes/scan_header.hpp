// What the DICOM headers of a series state about its acquisition.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.hpp"

namespace bregma::casefile {

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
  double bandwidth_Hz = 0.0;      // (0018,0095) per pixel; 0: not stated

  [[nodiscard]] std::string scanner() const; // manufacturer, model, serial number: those that are stated
  // The vendor has corrected distortion in the plane (DIS2D) or in space (DIS3D).
  [[nodiscard]] bool vendor_corrected() const;
};

// Of a DICOM file, or of the first DICOM file (by name) of a folder; with `series`, the first of that UID. Refused: no
// DICOM file, a file that is not whole.
[[nodiscard]] base::Result<ScanHeader> read_scan_header(const std::filesystem::path &path,
                                                        const std::string &series = {});

} // namespace bregma::casefile
