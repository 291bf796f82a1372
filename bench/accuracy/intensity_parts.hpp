// The parts of bench_intensity, and the images that they share.
#pragma once

#include <random>
#include <string>
#include <vector>

#include "algorithms/intensity/rigid_image.hpp"
#include "bench/record.hpp"

namespace bregma::bench {

struct IntensityOptions : Options {
  std::string mni = "../shared/data/images/mni";                  // CT, T1, T2 and PD templates, 2 mm
  std::string colin = "/usr/share/mricron/templates/ch2.nii.gz";  // one head, 1 mm
  std::string labels = "/usr/share/mricron/templates/aal.nii.gz"; // its regions
  std::string pictures;                                           // folder for the figures; none when empty
};

// Throws std::runtime_error with the reader's sentence.
[[nodiscard]] intensity::Volume load_volume(const std::string &path);

// One axial slice at z mm as 256 x 256 pixels of 1 mm, scaled to [0, 1], its centre at the origin; the surroundings are
// 0.
[[nodiscard]] intensity::Volume plane_of(const intensity::Volume &image, double z_mm);
// Gaussian noise on [0, 1], clamped to it.
[[nodiscard]] intensity::Volume with_noise(intensity::Volume image, double variance, unsigned seed);
// NaN outside the middle fraction of each side.
[[nodiscard]] intensity::Volume with_field_of_view(intensity::Volume image, double fraction);

struct Sweep {
  bool rotation = true; // degrees about the centre; otherwise pixels along x
  int reach = 60;       // from -reach to reach in whole steps
};
// The measure at each step, first at -reach. Planes are turned about the origin.
[[nodiscard]] std::vector<double> similarity_curve(intensity::SimilarityMeasure &measure, const Sweep &sweep);
// Where the measure is largest, in steps from the truth.
[[nodiscard]] int largest_at(intensity::SimilarityMeasure &measure, const Sweep &sweep);

// As in the thesis: 256 bins over the whole image's range, nearest pixel, corners filled with zeros.
[[nodiscard]] intensity::MeasureOptions as_printed();
// 64 bins, Parzen windows, the overlap only.
[[nodiscard]] inline intensity::MeasureOptions well_made() { return {}; }
// The same at half of the pixels, each sample moved within its pixel: nowhere do the two grids coincide.
[[nodiscard]] intensity::MeasureOptions off_grid();

inline constexpr double kSlice_mm = 10.0; // of the planes: through the ventricles
struct Planes {
  intensity::Volume ct, t1, t2, pd;
  explicit Planes(const IntensityOptions &options);
};

void plane_noise_figures(Report &report, const IntensityOptions &options);   // table 4.2
void significance_figures(Report &report, const IntensityOptions &options);  // what (35) leaves open
void plane_feature_figures(Report &report, const IntensityOptions &options); // tables 5.1 to 5.4
void reading_figures(Report &report, const IntensityOptions &options);       // adaptive image gradient; combinations
void variant_figures(Report &report, const IntensityOptions &options);       // table 2.2
void rigid_figures(Report &report,
                   const IntensityOptions &options); // success from 30 mm and 30 degrees, and from anywhere
void measure_figures(Report &report, const IntensityOptions &options); // success of each measure on three pairs
void one_mm_figures(Report &report, const IntensityOptions &options);
void speed_figures(Report &report, const IntensityOptions &options);    // beside elastix
void nonrigid_figures(Report &report, const IntensityOptions &options); // beside elastix
void coverage_figures(Report &report, const IntensityOptions &options);
void search_figures(Report &report, const IntensityOptions &options); // synthetic pairs from any pose
void drawn_figures(Report &report, const IntensityOptions &options);  // 2.3, 4.3 to 4.5, 5.1 and 5.4, into `pictures`

// A pair made from one head: grey-value map, bias field, noise, pose and field of view.
struct SyntheticPair {
  intensity::Volume reference, floating;
  intensity::ReferenceFromFloating truth;
};
struct SyntheticOptions {
  double spacing_mm = 2.0;
  double rotation_deg = 30.0, translation_mm = 20.0; // largest
  double min_field = 0.6;                            // of the third axis
};
[[nodiscard]] SyntheticPair synthetic_pair(const intensity::Volume &head, const SyntheticOptions &options,
                                           std::mt19937_64 &rng, parallel::Team &team);
// Uniform in -1 to 1, and normal; the same with every standard library.
[[nodiscard]] double uniform(std::mt19937_64 &rng);
[[nodiscard]] double normal(std::mt19937_64 &rng);
[[nodiscard]] Eigen::Vector3d direction(std::mt19937_64 &rng);

[[nodiscard]] int bench_threads(); // two

} // namespace bregma::bench
