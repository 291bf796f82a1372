// What the tissue models of algorithms/tissue reach, and beside what: docs/tissue_plane.md.
#include <iostream>

#include <CLI/CLI.hpp>

#include "bench/accuracy/tissue_thesis.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  bench::TissueBenchOptions options;
  std::string only;
  CLI::App app("Accuracy of the tissue models");
  bench::add_options(app, options);
  app.add_option("--case", options.case_folder, "case folder whose brain is deformed")->capture_default_str();
  app.add_option("--thesis-picture", options.thesis_picture, "write the picture of the thesis' run (SVG) to this file");
  app.add_option("--only", only, "one part: thesis")->check(CLI::IsMember({"thesis"}));
  CLI11_PARSE(app, argc, argv);

  bench::Report report(options.json);
  try {
    if (only.empty() || only == "thesis") {
      bench::thesis_figures(report, options);
    }
  } catch (const std::exception &e) {
    std::cerr << "bench_tissue: " << e.what() << '\n';
    return 2;
  }
  return report.all_hold() ? 0 : 1;
}
