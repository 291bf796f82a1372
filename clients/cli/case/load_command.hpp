// `bregma case load | close`: which case the daemon works on.
#pragma once

#include <CLI/App.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_load_commands(CLI::App &group, Context &context);

} // namespace bregma::cli
