// Descriptions of six-axis arms: Denavit-Hartenberg tables in TOML, and URDF.
//
//   name = "Nachi MZ07F"       # robots/mz07f.toml
//   [[joints]]                 # six, the one nearest to the base first
//   d_mm = 355                 # Rz(q + offset) Tz(d) Tx(a) Rx(alpha)
//   alpha_deg = 90
//   a_mm = 50
//   offset_deg = 0             # optional
//   min_deg = -170
//   max_deg = 170
//
// Of URDF the links and joints are read: revolute and continuous joints with limits, fixed joints between them; lengths
// in m. The base is the root link. The flange is the only link without children that six moving joints lead to.
// Meshes, inertia and everything else are ignored.
//
// Errors name the file, the line where it is known, the joint and the value.
#pragma once

#include <filesystem>
#include <string_view>

#include "algorithms/robot/arm_model.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// By the extension: .toml, or .urdf and .xml.
[[nodiscard]] base::Result<robot::ArmModel> read_arm(const std::filesystem::path &file);

// From text; `name` is the file in error messages.
[[nodiscard]] base::Result<robot::ArmModel> parse_dh_arm(std::string_view text, const std::string &name);
[[nodiscard]] base::Result<robot::ArmModel> parse_urdf_arm(std::string_view text, const std::string &name);

} // namespace bregma::casefile
