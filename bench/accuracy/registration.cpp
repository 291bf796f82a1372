// What the registrations of algorithms/registration reach, how fast, and beside what: docs/registration.md.
#include <iostream>

#include <CLI/CLI.hpp>

#include "bench/accuracy/registration_parts.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  bench::RegistrationBenchOptions options;
  std::string only;
  CLI::App app("Accuracy, robustness and time of the registrations");
  bench::add_options(app, options);
  app.add_option("--case", options.case_folder, "case folder whose scalp is the head")->capture_default_str();
  app.add_option("--basin", options.basin_file, "write the picture of the convergence basin (SVG) to this file");
  app.add_option("--only", only, "one part: surface or clouds")->check(CLI::IsMember({"surface", "clouds"}));
  CLI11_PARSE(app, argc, argv);

  bench::Report report(options.json);
  try {
    if (only != "clouds") {
      bench::surface_figures(report, options);
    }
    if (only != "surface") {
      bench::cloud_figures(report, options);
    }
  } catch (const std::exception &e) {
    std::cerr << "bench_registration: " << e.what() << '\n';
    return 2;
  }
  return report.all_hold() ? 0 : 1;
}
