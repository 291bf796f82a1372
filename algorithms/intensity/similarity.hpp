// How alike two images are, pixel by pixel: Wang 2014 eqs. (21)-(23).
//
// Both work on images of any dimension as lists of intensities of the same length; pairs with a NaN (outside one of
// them) are left out. NaN where the lengths differ or no pair is left. Pure, reentrant.
#pragma once

#include <span>

namespace bregma::intensity {

// Root of the mean squared difference, (21) and (22), in units of the intensities (there: grey values 0-255).
[[nodiscard]] double rmse(std::span<const float> a, std::span<const float> b) noexcept;

// Mutual information (23) of the joint histogram with `bins` equal bins over each image's own range, in nats. Not below
// zero; for an image and itself, its entropy. The figure grows with the number of bins: compare at the same only.
[[nodiscard]] double mutual_information(std::span<const float> a, std::span<const float> b, int bins = 64);

} // namespace bregma::intensity
