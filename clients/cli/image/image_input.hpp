// Common parts of `bregma image`: reading images, and the options of a measure.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "algorithms/intensity/similarity_measure.hpp"
#include "algorithms/parallel/team.hpp"
#include "base/result.hpp"
#include "casefile/volumes/volume.hpp"

namespace CLI {
class App;
}

namespace bregma::cli {

// A file or a DICOM folder, with its option for a file that does not state its space.
struct ImageFile {
  std::string path, space;
};
void add_image_file(CLI::App &command, ImageFile &file, const std::string &name, const std::string &help);

// The space that the option states.
[[nodiscard]] std::optional<casefile::Space> space_of(const ImageFile &file);

// notes: receives what was assumed.
[[nodiscard]] base::Result<intensity::Volume> read_image(const ImageFile &file, std::vector<std::string> &notes);

// Refused: an image with one grey value, of which nothing can be shown.
[[nodiscard]] base::Result<void> check_contrast(const intensity::Volume &image, const std::string &path);

// Voxels where the mask is 0 lose their value (NaN). The mask is a label image on the image's own grid. Refused:
// another grid, values that are no labels, no voxel that remains. Notes what was assumed.
[[nodiscard]] base::Result<void> apply_mask(intensity::Volume &image, const std::string &mask_path,
                                            const std::string &image_path, std::vector<std::string> &notes);

// Notes what the headers of two DICOM images state differently about their patient.
void compare_patients(const ImageFile &source, const ImageFile &target, std::vector<std::string> &notes);

// Leaves out what a scanner wrote where it measured nothing (intensity/padding.hpp), and notes that.
void leave_out_padding(intensity::Volume &image, const std::string &path, std::vector<std::string> &notes);

// --bins and the names of measures.
[[nodiscard]] std::vector<std::string> measure_names();
[[nodiscard]] intensity::Measure measure_named(const std::string &name);
void add_bins_option(CLI::App &command, int &bins);

// Up to two threads, as other registrations of files.
[[nodiscard]] int registration_threads();

// Brightest and darkest thousandth of the voxels count as their neighbours: metal and spikes would take the bins.
inline constexpr double kGreyTail = 0.001;

} // namespace bregma::cli
