// The reviewed variants of mutual information (thesis, 2.3.3) that need more than histograms of single voxels, and
// plain correlation. Internal to the room: similarity_measure.hpp makes them.
#pragma once

#include <memory>
#include <vector>

#include "algorithms/intensity/similarity_measure.hpp"

namespace bregma::intensity {

using MeasurePointer = std::unique_ptr<SimilarityMeasure>;

[[nodiscard]] MeasurePointer make_correlation(const Volume &reference, const Volume &floating,
                                              const MeasureOptions &options, parallel::Team &team);

// (6). The utility of a pair of grey values is the mean product of the two saliencies where it occurs.
[[nodiscard]] MeasurePointer make_q_mi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                       parallel::Team &team);
// (7)-(9) with w = (cos 2 alpha + 1) / 2 [Pluim 2000], gradients at a scale of 1.5 voxels, mean over the samples.
[[nodiscard]] MeasurePointer make_gi_mi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                        parallel::Team &team);

// (10), (11): neighbourhoods of radius 1.
[[nodiscard]] MeasurePointer make_rmi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                      parallel::Team &team);
// (14): each voxel with its nearest neighbours along the axes, in both orders.
[[nodiscard]] MeasurePointer make_second_order_mi(const Volume &reference, const Volume &floating,
                                                  const MeasureOptions &options, parallel::Team &team);

// (12), with regions around the nodes of a grid of linear B-splines.
[[nodiscard]] MeasurePointer make_c_mi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                       parallel::Team &team);
// (13): mean over the same regions of the MI of histograms that are half local, half global (lambda = 1/2).
[[nodiscard]] MeasurePointer make_semi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                       parallel::Team &team);

// (15): MI between the floating image and the reference joined with its fused ordinal feature (ordinal_feature.hpp).
[[nodiscard]] MeasurePointer make_lle_he(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                         parallel::Team &team);

} // namespace bregma::intensity
