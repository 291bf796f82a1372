// The commands of `bregma mri`.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_mri_register(CLI::App &mri, Context &context); // register

} // namespace bregma::cli
