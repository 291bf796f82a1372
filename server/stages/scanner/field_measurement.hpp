// The distortion field from two scans of the phantom: control points, correspondence with CT, fit, hold-out, file.
//
// The second scan, usually shorter, shows whether the phantom moved during the first. Pure apart from the file; takes
// seconds to a minute, so it runs on a thread of its own.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "algorithms/geometry/points.hpp"
#include "algorithms/image/grid.hpp"
#include "algorithms/mri/frames.hpp"
#include "algorithms/mri/scan_fields.hpp"
#include "base/result.hpp"

namespace bregma::server {

// A field in use, and where it comes from. Frame of the fields: Image of the patient position.
struct ScannerField {
  std::shared_ptr<const mri::ScanFields> scans; // the field of every scan
  mri::PatientPosition position = mri::PatientPosition::kHfs;
  std::string scanner;  // empty: not stated
  std::string identity; // for messages and the wire
  std::int64_t made_ns = 0;
  std::int64_t expires_ns = 0; // 0: never
  // 0 and NaN for a field that was read from a file.
  std::uint32_t points = 0;
  double initial_mm = 0.0, residual_mm = 0.0, residual_max_mm = 0.0, moved_mm = 0.0;
};

// Of a scan, from Device to the frame of the fields (mri/separation.hpp).
[[nodiscard]] Eigen::Vector3d in_field(const ScannerField &field, const Eigen::Vector3d &mm_per_Hz);

struct FieldMeasurement {
  image::Image<float, 3> phantom; // frame Device, as the next
  std::optional<image::Image<float, 3>> again;
  std::optional<image::Image<float, 3>> reversed;      // the whole phantom with the read-out reversed: B0 apart
  Eigen::Vector3d mm_per_Hz = Eigen::Vector3d::Zero(); // Device: of `phantom`, opposite for `reversed`; zero: not known
  geometry::Points3 reference_mm;                      // control points in CT
  double cell_mm = 15.0, bar_mm = 2.0;
  double max_moved_mm = 0.3;
  mri::PatientPosition position = mri::PatientPosition::kHfs;
  std::string scanner, protocol;
  std::filesystem::path file; // empty: the field is not saved
  int days = 90;              // until it expires; 0: never
  std::int64_t utc_ns = 0;
  std::shared_ptr<const std::atomic<bool>> unwanted; // set: nothing is saved. May be null
};

// Refused with a sentence: no grid, no certain correspondence, a phantom that moved, a file that cannot be written.
[[nodiscard]] base::Result<ScannerField> measure_field(const FieldMeasurement &input);

// A field that was saved. Its table is that of the file.
[[nodiscard]] base::Result<ScannerField> load_field(const std::filesystem::path &file);

} // namespace bregma::server
