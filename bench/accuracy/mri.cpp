// The MR scanner: registration of the robot to it, on the simulated scanner, in the layout of [Tuna 2022].
// docs/scanner.md, docs/mri.md.
#include <iostream>

#include <CLI/CLI.hpp>

#include "bench/accuracy/mri_parts.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  bench::MriBenchOptions options;
  CLI::App app("Accuracy and speed of distortion fields and of the registration of a robot to an MR scanner");
  bench::add_options(app, options,
                     {"distortion", "field", "tables", "coverage", "pillars", "quality", "polarity", "susceptibility",
                      "fiducials", "faults", "time"});
  app.add_option("--seeds", options.seeds, "Runs of each part; 0: as many as the part has by itself")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  app.add_option("--first", options.first,
                 "Coverage, susceptibility, fiducials: number of the first run, for samples in parts")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  app.add_option("--pictures", options.pictures, "Write the figures of the documentation to this folder");
  CLI11_PARSE(app, argc, argv);
  constexpr std::pair<const char *, void (*)(bench::Report &, const bench::MriBenchOptions &)> kParts[] = {
      {"distortion", bench::distortion_figures},
      {"field", bench::field_from_images},
      {"tables", bench::robot_tables},
      {"coverage", bench::robot_coverage},
      {"pillars", bench::robot_pillars},
      {"quality", bench::robot_quality},
      {"polarity", bench::robot_polarity},
      {"susceptibility", bench::robot_susceptibility},
      {"fiducials", bench::robot_fiducials},
      {"faults", bench::robot_faults},
      {"time", bench::robot_time},
  };
  bench::Report report(options.json);
  try {
    for (const auto &[name, part] : kParts) {
      if (options.wants(name)) {
        part(report, options);
      }
    }
  } catch (const std::exception &e) {
    std::cerr << "bench_mri: " << e.what() << '\n';
    return 2;
  }
  return report.all_hold() ? 0 : 1;
}
