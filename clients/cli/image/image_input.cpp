#include "clients/cli/image/image_input.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <set>
#include <thread>
#include <tuple>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/intensity/padding.hpp"
#include "casefile/volumes/label_check.hpp"
#include "casefile/volumes/patient.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

void add_image_file(CLI::App &command, ImageFile &file, const std::string &name, const std::string &help) {
  command.add_option(name, file.path, help + ": NIfTI, NRRD, MetaImage, or a folder with a DICOM series")->required();
  command.add_option("--" + name + "-space", file.space, "Space of a file that does not state it: ras or lps")
      ->check(CLI::IsMember({"ras", "lps"}));
}

std::optional<casefile::Space> space_of(const ImageFile &file) {
  if (file.space.empty()) {
    return std::nullopt;
  }
  return file.space == "ras" ? casefile::Space::kRas : casefile::Space::kLps;
}

base::Result<intensity::Volume> read_image(const ImageFile &file, std::vector<std::string> &notes) {
  return casefile::read_volume(file.path, {.series = {}, .space = space_of(file)}, &notes);
}

base::Result<void> check_contrast(const intensity::Volume &image, const std::string &path) {
  return intensity::grey_range(image.voxels).constant()
             ? base::failure(path + ": the image has one grey value only: there is nothing to compare")
             : base::Result<void>();
}

base::Result<void> apply_mask(intensity::Volume &image, const std::string &mask_path, const std::string &image_path,
                              std::vector<std::string> &notes) {
  const auto mask = casefile::read_labels(mask_path, {}, &notes);
  if (!mask) {
    return tl::unexpected(mask.error());
  }
  if (!casefile::same_grid(*mask, image)) {
    const auto text = [](const image::Grid<3> &grid) {
      return std::to_string(grid.size[0]) + " x " + std::to_string(grid.size[1]) + " x " + std::to_string(grid.size[2]);
    };
    return base::failure(mask_path + ": a mask must have the voxels of its image, and this one (" + text(*mask) +
                         ") does not lie on those of " + image_path + " (" + text(image) + ")");
  }
  std::size_t kept = 0;
  std::set<std::int16_t> labels;
  for (std::size_t i = 0; i < image.voxels.size(); ++i) {
    if (mask->voxels[i] != 0) {
      ++kept;
      labels.insert(mask->voxels[i]);
    } else {
      image.voxels[i] = std::numeric_limits<float>::quiet_NaN();
    }
  }
  if (kept == 0) {
    return base::failure(mask_path + ": every voxel is 0, so nothing remains to compare");
  }
  if (kept == image.voxels.size()) {
    notes.push_back(mask_path + ": no voxel is 0, so the mask leaves nothing out");
  }
  if (labels.size() > 1) {
    notes.push_back(mask_path + ": holds " + std::to_string(labels.size()) + " labels; all of them are compared");
  }
  return {};
}

void compare_patients(const ImageFile &source, const ImageFile &target, std::vector<std::string> &notes) {
  const auto of_source = casefile::read_patient(source.path, {});
  const auto of_target = casefile::read_patient(target.path, {});
  if (!of_source || !of_target) {
    return;
  }
  std::string differing; // the values themselves name a person, and are not printed
  for (const auto &[what, a, b] : {std::tuple("name", &of_source->name, &of_target->name),
                                   {"patient ID", &of_source->id, &of_target->id},
                                   {"birth date", &of_source->birth_date, &of_target->birth_date}}) {
    if (!a->empty() && !b->empty() && *a != *b) {
      differing += (differing.empty() ? "" : ", ") + std::string(what);
    }
  }
  if (!differing.empty()) {
    notes.push_back("the DICOM headers of the two images differ in: " + differing +
                    ". Make sure that both are of one patient; grey values alone do not show that");
  }
}

void leave_out_padding(intensity::Volume &image, const std::string &path, std::vector<std::string> &notes) {
  if (const intensity::Padding found = intensity::leave_out_padding(image); found.voxels > 0) {
    notes.push_back(path + ": " + std::to_string(found.voxels) + " voxels are padding (" +
                    fixed(static_cast<double>(found.value), 0) +
                    "), far below all other values; they are not compared");
  }
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
