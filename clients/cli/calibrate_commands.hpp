// `bregma calibrate hand-eye | beam | range`: calibrations of a robot and its range sensor, from files.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_calibrate_hand_eye(CLI::App &parent, Context &context);
void add_calibrate_beam(CLI::App &parent, Context &context);
void add_calibrate_range(CLI::App &parent, Context &context);

} // namespace bregma::cli
