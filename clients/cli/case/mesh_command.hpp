// `bregma case mesh`: meshes a case's brain with tetrahedra and reports their quality.
#pragma once

#include <CLI/App.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_mesh_command(CLI::App &group, Context &context);

} // namespace bregma::cli
