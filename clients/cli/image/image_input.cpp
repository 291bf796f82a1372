#include "clients/cli/image/image_input.hpp"

#include <algorithm>
#include <optional>
#include <thread>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "casefile/volumes/volume.hpp"

namespace bregma::cli {

void add_image_file(CLI::App &command, ImageFile &file, const std::string &name, const std::string &help) {
  command.add_option(name, file.path, help + ": NIfTI, NRRD, MetaImage, or a folder with a DICOM series")->required();
  command.add_option("--" + name + "-space", file.space, "Space of a file that does not state it: ras or lps")
      ->check(CLI::IsMember({"ras", "lps"}));
}

base::Result<intensity::Volume> read_image(const ImageFile &file, std::vector<std::string> &notes) {
  std::optional<casefile::Space> space;
  if (!file.space.empty()) {
    space = file.space == "ras" ? casefile::Space::kRas : casefile::Space::kLps;
  }
  return casefile::read_volume(file.path, {.series = {}, .space = space}, &notes);
}

std::vector<std::string> measure_names() {
  std::vector<std::string> out;
  for (const intensity::MeasureName &m : intensity::kMeasures) {
    out.emplace_back(m.name);
  }
  return out;
}

intensity::Measure measure_named(const std::string &name) {
  const auto *const at = std::find_if(intensity::kMeasures.begin(), intensity::kMeasures.end(),
                                      [&](const intensity::MeasureName &m) { return m.name == name; });
  return at == intensity::kMeasures.end() ? intensity::Measure::kNmi : at->measure;
}

void add_bins_option(CLI::App &command, int &bins) {
  command.add_option("--bins", bins, "Bins of the joint histogram along each axis")
      ->check(CLI::Range(intensity::kMinBins, intensity::kMaxBins))
      ->capture_default_str();
}

int registration_threads() { return static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1U, 2U)); }

} // namespace bregma::cli
