// The convergence basin of local surface registration: success rate by distance of the start from the true pose.
#pragma once

#include <string>

#include "algorithms/surface/surface_field.hpp"
#include "bench/accuracy/registration_head.hpp"

namespace bregma::bench {

// 0-180 degrees by 0-100 mm, `runs` starts per cell; writes an SVG. Throws std::runtime_error when it cannot be
// written.
void draw_basin(Report &report, const Head &head, const surface::SurfaceField &field, const std::string &file,
                int runs);

} // namespace bregma::bench
