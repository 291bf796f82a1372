// Accuracy and time of the tissue models of algorithms/tissue, with peers: docs/tissue_verification.md and
// docs/tissue_plane.md.
#include <iostream>

#include <CLI/CLI.hpp>

#include "bench/accuracy/tissue_parts.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  bench::TissueBenchOptions options;
  std::string convergence, shift_picture;
  CLI::App app("Accuracy and speed of the tissue models");
  bench::add_options(app, options, {"analytic", "speed", "calculix", "thesis", "shift", "hertz", "robustness"});
  app.add_option("--case", options.case_folder, "case folder whose brain is deformed")->capture_default_str();
  app.add_option("--thesis-picture", options.thesis_picture, "write the picture of the thesis' run (SVG) to this file");
  app.add_option("--convergence", convergence, "write the picture of the errors under refinement (SVG) to this file");
  app.add_option("--shift-picture", shift_picture, "write the picture of the brain shift (SVG) to this file");
  CLI11_PARSE(app, argc, argv);

  bench::Report report(options.json);
  try {
    if (options.wants("analytic")) {
      bench::analytic_figures(report, options, convergence);
    }
    if (options.wants("speed")) {
      bench::speed_figures(report, options);
    }
    if (options.wants("calculix")) {
      bench::calculix_figures(report, options);
    }
    if (options.wants("thesis")) {
      bench::thesis_figures(report, options);
    }
    if (options.wants("shift")) {
      bench::shift_figures(report, options, shift_picture);
    }
    if (options.wants("hertz")) {
      bench::hertz_figures(report, options);
    }
    if (options.wants("robustness")) {
      bench::robustness_figures(report, options);
    }
  } catch (const std::exception &e) {
    std::cerr << "bench_tissue: " << e.what() << '\n';
    return 2;
  }
  return report.all_hold() ? 0 : 1;
}
