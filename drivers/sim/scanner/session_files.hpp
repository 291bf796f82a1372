// Writes a simulated session as files: the frame, pairs of stacks, the list of scans that `bregma mri register` reads,
// and apart from them the truth.
#pragma once

#include <filesystem>

#include "base/result.hpp"
#include "drivers/sim/scanner/simulated_scanner.hpp"

namespace bregma::sim::scanner {

struct SessionFiles {
  bool phantom = false;    // also the phantom in CT and MR
  double ct_coarser = 2.0; // 1: the paper's voxels, 334 MB
  bool reversed = false;   // also foregrounds with the current reversed
  bool opposed = false;    // also images, of frame and phantom, with the read-out reversed
  bool vendor = false;     // images as the vendor's correction leaves them
  bool mr = true;          // false: only what does not come from the scanner, the frame and the CT
  // Where the frame's origin lies in the robot's base. The axes of both are parallel.
  Vector3d frame_at_mm = Vector3d::Zero();
};

// Into an existing or new folder: frame.toml, scans.toml, NRRD images, truth.json. Files of the same names are
// replaced. Without MR images there is no scans.toml.
[[nodiscard]] base::Result<void> write_session(const std::filesystem::path &folder, SimulatedScanner &scanner,
                                               const SessionFiles &files);

} // namespace bregma::sim::scanner
