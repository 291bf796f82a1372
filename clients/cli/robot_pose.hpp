// `bregma robot pose`: the poses for a hand-eye calibration, one at each place where the arm stands.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_robot_pose(CLI::App &robot, Context &context);

} // namespace bregma::cli
