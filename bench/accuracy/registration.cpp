// Accuracy and time of the registrations of algorithms/registration, with peers: docs/registration.md.
#include <iostream>

#include <CLI/CLI.hpp>

#include "bench/accuracy/registration_parts.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  bench::RegistrationBenchOptions options;
  CLI::App app("Accuracy, robustness and time of the registrations");
  bench::add_options(app, options, bench::kRegistrationParts);
  app.add_option("--case", options.case_folder, "case folder whose scalp is the head")->capture_default_str();
  app.add_option("--basin", options.basin_file, "write the picture of the convergence basin (SVG) to this file");
  app.add_option("--runs", options.runs, "runs per cell of table 1; fewer of its slow peers")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  app.add_option("--slow-runs", options.slow_runs,
                 "runs per cell of annealing, the genetic algorithm and Go-ICP; 0: a fifth and a twentieth of --runs")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  app.add_option("--pictures", options.pictures, "write the figures of table 1 to this folder (SVG)");
  app.add_option("--head", options.heads, "other heads: surfaces or images (those of ../shared/data that are there)");
  CLI11_PARSE(app, argc, argv);

  bench::Report report(options.json);
  try {
    bench::surface_figures(report, options);
    if (options.wants("heads")) {
      bench::head_figures(report, options);
    }
    if (options.wants("points")) {
      bench::point_figures(report, options);
    }
    if (options.wants("clouds")) {
      bench::cloud_figures(report, options);
    }
    if (options.wants("splines")) {
      bench::spline_figures(report, options);
    }
    if (options.wants("curves")) {
      bench::curve_figures(report);
    }
  } catch (const std::exception &e) {
    std::cerr << "bench_registration: " << e.what() << '\n';
    return 2;
  }
  return report.all_hold() ? 0 : 1;
}
