// What a camera beside the simulated arm would see, as bregma-sim-arm states it to bregma-sim-tracker: where flange and
// head truly are. One line (base/checked_line.hpp) per moment:
//
//   scene,<time, us>,<flange: x, y, z, mm>,<quaternion w, x, y, z>,<head: x, y, z>,<w, x, y, z>    both in RobotBase
//
// Pure, any thread, arbitrary bytes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "algorithms/geometry/rigid3.hpp"
#include "drivers/sim/arm/moving_head.hpp"

namespace bregma::sim {

struct Scene {
  std::uint64_t time_us = 0; // of the arm's clock
  geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::RobotFlange> T_base_flange;
  BaseImage T_base_image;
};

inline constexpr std::size_t kMaxSceneLine = 640; // without its end

// With \r\n.
[[nodiscard]] std::string line_of(const Scene &scene);
// Without the end of the line. The error states its problem.
[[nodiscard]] tl::expected<Scene, std::string_view> parse_scene(std::string_view line);

} // namespace bregma::sim
