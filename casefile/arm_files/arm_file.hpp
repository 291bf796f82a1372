// Descriptions of six-axis arms: Denavit-Hartenberg tables in TOML (casefile/dh_arm.hpp), and URDF.
//
// Of URDF the links and joints are read: revolute and continuous joints with limits, fixed joints between them; lengths
// in m. The base is the root link. The flange is the only link without children that six moving joints lead to.
// Meshes, inertia and everything else are ignored.
//
// Errors name the file, the line where it is known, the joint and the value.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "algorithms/robot/arm_model.hpp"
#include "base/result.hpp"
#include "casefile/dh_arm.hpp"

namespace bregma::casefile {

// By the extension: .toml, or .urdf and .xml.
[[nodiscard]] base::Result<robot::ArmModel> read_arm(const std::filesystem::path &file);

// From text; `name` is the file in error messages.
[[nodiscard]] base::Result<robot::ArmModel> parse_urdf_arm(std::string_view text, const std::string &name);

} // namespace bregma::casefile
