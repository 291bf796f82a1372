// `bregma tissue shift`: how a case's brain sinks when fluid has run out of the opened skull.
#pragma once

#include <CLI/App.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_shift_command(CLI::App &group, Context &context);

} // namespace bregma::cli
