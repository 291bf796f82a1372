// Parts of bench_mri.
#pragma once

#include "bench/record.hpp"

namespace bregma::bench {

struct MriBenchOptions : Options {
  int seeds = 0;        // 0: as many as the part has by itself
  int first = 0;        // run of coverage, susceptibility and fiducials
  std::string pictures; // folder for figures; none when empty
};

void distortion_figures(Report &report, const MriBenchOptions &options); // table 3 on a real phantom; times
void field_from_images(Report &report, const MriBenchOptions &options);  // control points, residual, true map; bubbles
void robot_tables(Report &report, const MriBenchOptions &options);       // tables 4 to 7 of [Tuna 2022]
void robot_coverage(Report &report, const MriBenchOptions &options);     // predicted TRE against the truth
void robot_pillars(Report &report, const MriBenchOptions &options);      // 8 mid, 8 outer, 16; two phantoms
void robot_susceptibility(Report &report, const MriBenchOptions &options); // that enters after mapping
void robot_fiducials(Report &report, const MriBenchOptions &options);      // coils, Z-frame, micro-coils
void robot_quality(Report &report, const MriBenchOptions &options);        // thickness, SNR
void robot_faults(Report &report, const MriBenchOptions &options);   // wrong inputs: refusal or a correct remainder
void robot_polarity(Report &report, const MriBenchOptions &options); // both polarities of the current against one
void robot_time(Report &report, const MriBenchOptions &options);     // after the last slice, and for a batch

} // namespace bregma::bench
