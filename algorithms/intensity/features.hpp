// Features of an image: other images on the same grid, which show its structure to a similarity measure.
//
// Images in the plane are volumes with one slice (as_volume); derivatives along an axis with one voxel are zero. NaN
// marks voxels without a value. Derivatives are per mean voxel spacing, so that they have the unit of the grey values,
// and anisotropic voxels count as they lie in space. Pure; threads are those of the team.
#pragma once

#include <vector>

#include "algorithms/image/grid.hpp"
#include "algorithms/parallel/team.hpp"

namespace bregma::intensity {

using Volume = image::Image<float, 3>;

[[nodiscard]] Volume as_volume(const image::Image<float, 2> &plane);

struct GreyRange {
  float low = 0.0F, high = 0.0F;
  [[nodiscard]] bool constant() const { return !(high > low); }
};
// Of the finite voxels; the fraction `tail` of them is left out at each end. Both 0 without any.
[[nodiscard]] GreyRange grey_range(const std::vector<float> &values, double tail = 0.0);

// Central differences along the axes of the frame; one-sided at the border.
struct Gradient {
  std::vector<float> x, y, z; // along the axes of the frame (RAS), not of the grid
};
[[nodiscard]] Gradient gradient(const Volume &image, parallel::Team &team);
// (34)
[[nodiscard]] std::vector<float> gradient_magnitude(const Volume &image, parallel::Team &team);
// Significance of each voxel (35): (G + I) / (G_max + I_max), grey values counted from the smallest one.
[[nodiscard]] std::vector<float> significance(const Volume &image, parallel::Team &team);

// The adaptive image gradient (5.3.1). As printed, it is zero nearly everywhere: it multiplies the gradient with the
// distance to the next voxel with a gradient, and one of the two is zero. docs/images.md compares the readings.
enum class AigReading {
  kPrinted,
  kDistance, // distance to the nearest edge: where the gradient is above Otsu's threshold
  kDistanceTimesSlope,
  kDistanceTimesGrey, // "incorporating the distance into the original image"
};
[[nodiscard]] std::vector<float> adaptive_image_gradient(const Volume &image, AigReading reading, parallel::Team &team);

// Standard deviation over the neighbours up to `radius` voxels along each axis.
[[nodiscard]] std::vector<float> standard_deviation(const Volume &image, int radius, parallel::Team &team);
// Smaller eigenvalue's root of the smoothed structure tensor [Shi 1994]: large at corners, small at edges.
[[nodiscard]] std::vector<float> corners(const Volume &image, parallel::Team &team);

enum class Feature { kGrey, kGradient, kSignificance, kAig, kStandardDeviation, kCorners };
[[nodiscard]] std::vector<float> feature_of(const Volume &image, Feature feature, AigReading reading,
                                            parallel::Team &team);

// Distance of each voxel to the nearest one of the set, in units of the mean spacing; 0 everywhere where it is empty
// [Felzenszwalb 2012].
[[nodiscard]] std::vector<float> distance_to(const Volume &grid, const std::vector<char> &set);
// Threshold between two classes of values [Otsu 1979].
[[nodiscard]] float otsu_threshold(const std::vector<float> &values);

} // namespace bregma::intensity
