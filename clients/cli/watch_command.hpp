// `bregma watch`: the state, continuously.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_watch_command(CLI::App &app, Context &context);

} // namespace bregma::cli
