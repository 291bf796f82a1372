// Several scans of a phantom, for `bregma mri field`: the gradients' part and that of B0.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "algorithms/mri/point_matching.hpp"
#include "algorithms/mri/separation.hpp"
#include "base/result.hpp"

namespace bregma::cli {

// How B0 displaces spins in the scans; lists have a value per scan, or one for all.
struct ScanProtocols {
  std::vector<std::string> read_outs; // R, L, A, P, S, I: where a spin of higher frequency is shifted to
  std::vector<std::string> slices;    // the same along the normal of the slices; empty: not shifted
  double pixel_mm = 0.0, bandwidth_Hz = 0.0;
  double thickness_mm = 0.0, pulse_Hz = 0.0;
  bool own_placement = false; // the scans may differ perpendicular to the read-outs: taken out, and stated
};

// What is missing in the protocols of so many scans; empty: nothing.
[[nodiscard]] std::string missing_in(const ScanProtocols &protocols, std::size_t scans);
// How B0 displaces spins in one of the scans. Refused: a direction that is none.
[[nodiscard]] base::Result<Eigen::Vector3d> scan_movement(const ScanProtocols &protocols, std::size_t scan);

struct FieldOfScans {
  mri::SeparatedField field;
  Eigen::Vector3d mm_per_Hz; // of the first scan
  std::string text;          // residual of each scan by one scan, and by all
  nlohmann::json figures;
};

// Control points in RAS. Refused with a sentence: a scan whose correspondence is not certain, protocols that are not
// complete, scans that do not separate B0.
[[nodiscard]] base::Result<FieldOfScans>
field_of_scans(const geometry::Points3 &ct, const std::vector<geometry::Points3> &scans,
               const std::vector<std::string> &names, const ScanProtocols &protocols, const mri::MatchOptions &options);

} // namespace bregma::cli
