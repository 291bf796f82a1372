// Similarity of two images, pixel by pixel [thesis, eqs. 21-23].
//
// Images of any dimension are lists of intensities of the same length. A pixel outside an image is NaN there. Figures
// are over the overlap: pairs with a NaN are left out. They are NaN where the lengths differ or no pair remains.
// Reentrant. For registration see similarity_measure.hpp.
#pragma once

#include <initializer_list>
#include <span>
#include <vector>

namespace bregma::intensity {

// Root of the mean squared difference, (21) and (22), in units of the intensities (in the thesis: grey values 0-255).
[[nodiscard]] double rmse(std::span<const float> a, std::span<const float> b) noexcept;

// Mutual information (23) of the joint histogram with `bins` equal bins over each image's own range, in nats. Not below
// zero; for an image and itself, its entropy. The figure grows with the number of bins: compare at the same only.
[[nodiscard]] double mutual_information(std::span<const float> a, std::span<const float> b, int bins = 64);

// Reduces images to their common overlap: a pixel that is NaN in one of them becomes NaN in all. Figures of several
// warps against one reference can only be compared over the same pixels: otherwise a warp that pushes pixels out of
// view improves its figure. Throws std::invalid_argument where the lengths differ.
void restrict_to_overlap(std::initializer_list<std::vector<float> *> images);

} // namespace bregma::intensity
