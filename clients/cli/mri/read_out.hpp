// How B0 displaces the spins of a scan, from what the operator and headers state.
#pragma once

#include <optional>
#include <string>

#include <Eigen/Core>

#include "algorithms/mri/scan_fields.hpp"
#include "base/result.hpp"
#include "casefile/volumes/scan_header.hpp"

namespace bregma::cli {

// R, L, A, P, S or I, as a unit vector (RAS).
[[nodiscard]] base::Result<Eigen::Vector3d> ras_direction(const std::string &letter);

// mm per Hz (mri/separation.hpp) of a scan whose read-out shifts a spin of higher frequency towards `read_out`.
// T_ras_index: of the image. The pixel is the acquired one that the header states, otherwise the spacing of the image's
// axis nearest to the read-out. bandwidth_Hz: 0: that of the header. Refused: a bandwidth that nothing states, and a
// read-out across the one that the header states.
[[nodiscard]] base::Result<Eigen::Vector3d> movement_in(const Eigen::Matrix4d &T_ras_index, const std::string &read_out,
                                                        double bandwidth_Hz,
                                                        const std::optional<casefile::ScanHeader> &header);

// What a field leaves of B0 in scans with this mm_per_Hz (frame of the field; none: not stated): a note, or an empty
// text. where: what states the read-out.
[[nodiscard]] std::string b0_note(const mri::ScanFields &fields, const std::optional<Eigen::Vector3d> &mm_per_Hz,
                                  const std::string &where);

} // namespace bregma::cli
