// `bregma register points | surface | scan | cloud | curves` on files; one source file per command.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_register_points(CLI::App &parent, Context &context);
void add_register_surface(CLI::App &parent, Context &context);
void add_register_scan(CLI::App &parent, Context &context);
void add_register_cloud(CLI::App &parent, Context &context);
void add_register_curves(CLI::App &parent, Context &context);

} // namespace bregma::cli
