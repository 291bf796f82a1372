// `bregma tissue shift`: predicts how a case's brain sinks when fluid has drained from the opened skull.
#pragma once

#include <CLI/App.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_shift_command(CLI::App &group, Context &context);

} // namespace bregma::cli
