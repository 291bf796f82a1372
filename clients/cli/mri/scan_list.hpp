// The list of scans that register a robot (TOML), with their images.
//
//   frame = "frame.toml"
//   patient_position = "HFS"        # of all series
//   read_out = "L"                  # where that of all series shifts a spin of higher frequency to; optional
//   bandwidth_Hz = 260              # of all series, per pixel; with read_out
//   [[scans]]
//   name = "top"
//   orientation = "C"               # of the slices, as the scanner prints it: C, S, T, T>C38.3>S10.0
//   background = "top_off.nrrd"     # a file, or a folder with a DICOM series
//   foreground = "top_on.nrrd"
//   opposite = "top_reversed.nrrd"  # current reversed; optional
//   background_opposed = "top_off_opposed.nrrd"  # both with the read-out reversed; optional, then for all scans
//   foreground_opposed = "top_on_opposed.nrrd"
//   on = ["mid-top", "inner-top"]   # groups or coils that carried current
//   verify = ["inner-top"]          # of these, those that verify the registration; optional
//
// Paths are relative to the list. Errors name file, line, key and value.
#pragma once

#include <filesystem>
#include <list>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/mri/coils/robot_registration.hpp"
#include "algorithms/mri/frames.hpp"
#include "base/result.hpp"

namespace bregma::cli {

struct ScanList {
  mri::CoilFrame frame;
  mri::PatientPosition position = mri::PatientPosition::kHfs;
  std::list<mri::Stack> images;   // scans refer to them
  std::vector<std::string> files; // of the images
  std::vector<mri::CoilScan> scans;
  std::optional<Eigen::Vector3d> mm_per_Hz; // Image (RAS): movement by B0 (mri/separation.hpp); none: not stated

  [[nodiscard]] bool opposed() const { return !scans.empty() && scans.front().reversed_foreground != nullptr; }
};

[[nodiscard]] base::Result<ScanList> read_scan_list(const std::filesystem::path &file, std::vector<std::string> *notes);

// An image (RAS) as slices along its third axis, in Device. Refused where no axis of it is along the normal, or where
// its pixels are square across another one.
[[nodiscard]] base::Result<mri::Stack> slices_of(const mri::Stack &ras, const Eigen::Vector3d &normal_patient,
                                                 mri::PatientPosition position, const std::string &what);

} // namespace bregma::cli
