// A six-axis arm by its Denavit-Hartenberg table (TOML):
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
// Errors name the file, the joint and the value.
#pragma once

#include <string>
#include <string_view>

#include "algorithms/robot/arm_model.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// `name` is the file in error messages.
[[nodiscard]] base::Result<robot::ArmModel> parse_dh_arm(std::string_view text, const std::string &name);

} // namespace bregma::casefile
