// `bregma case load | close`: selects the daemon's case.
#pragma once

#include <CLI/App.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_load_commands(CLI::App &group, Context &context);

} // namespace bregma::cli
