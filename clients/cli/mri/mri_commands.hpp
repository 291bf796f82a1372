// The commands of `bregma mri`.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_mri_points(CLI::App &mri, Context &context);   // points
void add_mri_field(CLI::App &mri, Context &context);    // field
void add_mri_correct(CLI::App &mri, Context &context);  // correct
void add_mri_register(CLI::App &mri, Context &context); // register
void add_mri_step(CLI::App &mri, Context &context);     // step
void add_mri_acquire(CLI::App &mri, Context &context);  // acquire

} // namespace bregma::cli
