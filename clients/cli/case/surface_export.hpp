// `bregma case export`.
#pragma once

namespace CLI {
class App;
}

namespace bregma::cli {

struct Context;

void add_surface_export(CLI::App &group, Context &context);

} // namespace bregma::cli
