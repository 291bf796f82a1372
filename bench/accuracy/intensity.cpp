// Comparison and registration of images: the thesis' tables, success, time and predicted error: docs/images.md.
#include <functional>
#include <iostream>
#include <map>

#include <CLI/CLI.hpp>

#include "bench/accuracy/intensity_parts.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  bench::IntensityOptions options;
  CLI::App app("Similarity measures of images and their registration");
  bench::add_options(app, options, bench::kIntensityParts);
  app.add_option("--mni", options.mni, "folder with the templates scct, avg152T1, avg152T2 and avg152PD")
      ->capture_default_str();
  app.add_option("--colin", options.colin, "one head at 1 mm")->capture_default_str();
  app.add_option("--pictures", options.pictures, "Write the figures of the documentation to this folder");
  CLI11_PARSE(app, argc, argv);

  using Part = void (*)(bench::Report &, const bench::IntensityOptions &);
  const std::map<std::string, Part> parts{{"noise", bench::plane_noise_figures},
                                          {"significance", bench::significance_figures},
                                          {"features", bench::plane_feature_figures},
                                          {"readings", bench::reading_figures},
                                          {"variants", bench::variant_figures},
                                          {"rigid", bench::rigid_figures},
                                          {"measures", bench::measure_figures},
                                          {"one-mm", bench::one_mm_figures},
                                          {"speed", bench::speed_figures},
                                          {"nonrigid", bench::nonrigid_figures},
                                          {"coverage", bench::coverage_figures},
                                          {"figures", bench::drawn_figures}};
  bench::Report report(options.json);
  try {
    for (const std::string &name : bench::kIntensityParts) {
      if (options.wants(name)) {
        parts.at(name)(report, options);
      }
    }
  } catch (const std::exception &e) {
    std::cerr << "bench_intensity: " << e.what() << '\n';
    return 2;
  }
  return report.all_hold() ? 0 : 1;
}
