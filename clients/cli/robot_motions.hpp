// Motions of an arm from the command line: this program is the client that holds the deadman (idl/robot.idl).
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

// `bregma robot move`, `stop`, `hold` and `reset`.
void add_robot_motions(CLI::App &robot, Context &context);
// `bregma robot scan move`.
void add_scan_motion(CLI::App &scan, Context &context);

} // namespace bregma::cli
