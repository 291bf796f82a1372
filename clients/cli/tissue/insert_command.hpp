// `bregma tissue insert`: drives a probe along a planned trajectory.
#pragma once

#include <CLI/App.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_insert_command(CLI::App &group, Context &context);

} // namespace bregma::cli
