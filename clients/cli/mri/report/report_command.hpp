// `bregma mri report`.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_mri_report(CLI::App &mri, Context &context);

} // namespace bregma::cli
