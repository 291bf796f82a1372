// Comparison and registration of images: the thesis' tables, success, time and predicted error: docs/images.md.
#include <exception>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "bench/accuracy/intensity_parts.hpp"

namespace {

namespace bench = bregma::bench;
using Part = void (*)(bench::Report &, const bench::IntensityOptions &);

constexpr std::pair<const char *, Part> kParts[] = {
    {"noise", bench::plane_noise_figures},
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
    {"search", bench::search_figures},
    {"figures", bench::drawn_figures},
};

} // namespace

int main(int argc, char **argv) {
  bench::IntensityOptions options;
  CLI::App app("Similarity measures of images and their registration");
  std::vector<std::string> names;
  for (const auto &[name, part] : kParts) {
    names.emplace_back(name);
  }
  bench::add_options(app, options, names);
  app.add_option("--mni", options.mni, "folder with the templates scct, avg152T1, avg152T2 and avg152PD")
      ->capture_default_str();
  app.add_option("--colin", options.colin, "one head at 1 mm")->capture_default_str();
  app.add_option("--pictures", options.pictures, "Write the figures of the documentation to this folder");
  CLI11_PARSE(app, argc, argv);
  bench::Report report(options.json);
  try {
    for (const auto &[name, part] : kParts) {
      if (options.wants(name)) {
        part(report, options);
      }
    }
  } catch (const std::exception &e) {
    std::cerr << "bench_intensity: " << e.what() << '\n';
    return 2;
  }
  return report.all_hold() ? 0 : 1;
}
