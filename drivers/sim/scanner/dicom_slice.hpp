// One slice as a DICOM file (part 10, MR image storage, explicit VR, little endian), as a scanner writes it.
//
// Pure, any thread.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include <Eigen/Core>

namespace bregma::sim::scanner {

struct DicomSlice {
  int columns = 0, rows = 0;
  std::span<const std::uint16_t> pixels; // row-major, columns * rows
  Eigen::Vector3d position_mm;           // of the first pixel, in Patient (LPS)
  Eigen::Vector3d along_row, along_column;
  double column_spacing_mm = 1.0, row_spacing_mm = 1.0;
  double thickness_mm = 1.0;
  std::string patient_position = "HFS";
  std::string study_uid, series_uid, instance_uid;
  int series = 1, instance = 1;
  std::string description;       // of the series
  std::string date = "20260101"; // YYYYMMDD
  double echo_ms = 0.0, repetition_ms = 0.0, bandwidth_Hz = 0.0;
  bool phase_along_columns = true; // (0018,1312) COL: the read-out runs along the rows
  bool vendor_corrected = false;   // DIS3D in (0008,0008), otherwise ND
};

[[nodiscard]] std::string dicom_bytes(const DicomSlice &slice);

} // namespace bregma::sim::scanner
