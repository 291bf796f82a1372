// The file of a robot's registration frame (TOML), and the list of scans that register it.
//
//   name = "tuna"
//   build_sigma_mm = 0.2      # of each coordinate; optional
//   x_points_to = "L"         # L R A P H F of the patient: how the frame is mounted, roughly; both or none
//   z_points_to = "A"
//   [[coils]]
//   name = "mid-top-1"
//   group = "mid-top"         # coils that are switched together
//   position_mm = [-72, -66, 55]  # in the robot's base
//
// Errors name file, line, key and value.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "algorithms/mri/coil_frame.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// Refused: fewer than four coils, names that repeat, that are the group of another coil or that no pattern can hold,
// two coils in the same place, directions that are not perpendicular.
[[nodiscard]] base::Result<mri::CoilFrame> read_coil_frame(const std::filesystem::path &file);

// Reads back to the same frame.
[[nodiscard]] std::string coil_frame_text(const mri::CoilFrame &frame);

// Coils of a pattern, bit i for coil i: "background" (none), or groups and coils joined by "+". Otherwise a sentence
// with the unknown word. For frames of at most 64 coils.
[[nodiscard]] tl::expected<std::uint64_t, std::string> coils_of(const mri::CoilFrame &frame,
                                                                const std::string &pattern);

} // namespace bregma::casefile
