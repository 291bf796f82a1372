// The part of the gradients and the part of B0, from several scans of a phantom.
//
// The gradients displace a spin alike in every scan. B0 displaces it along the read-out by pixel / bandwidth per Hz,
// and along the normal of its slice by thickness / bandwidth of the pulse per Hz. Scans with opposed read-outs, or in
// three orientations, therefore separate both:
//
//   imaged_s = true + G(true) + B0(true) d_s
//
// At the control points both parts are estimated in turn, each from what the other leaves, until neither changes, as
// the iterations named as future work in [Tuna 2022, VII, reference 14] do; that reference itself was not available. B0
// is then a series of solid harmonics, G a DistortionField.
//
// Units: mm and Hz; the frame's origin is the isocentre. Pure, any thread; allocates.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <tl/expected.hpp>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/distortion_field.hpp"
#include "algorithms/mri/harmonic_series.hpp"
#include "algorithms/mri/point_matching.hpp"

namespace bregma::mri {

// d_s. read_out and normal: unit vectors in the direction in which a spin of higher frequency is shifted. Without
// pulse_Hz (0) slices are not shifted: a phase-encoded slab.
[[nodiscard]] Eigen::Vector3d b0_movement(const Eigen::Vector3d &read_out, double pixel_mm, double bandwidth_Hz,
                                          const Eigen::Vector3d &normal = Eigen::Vector3d::Zero(),
                                          double thickness_mm = 0.0, double pulse_Hz = 0.0);

struct PhantomScan {
  geometry::Points3 imaged_mm; // a column per control point; NaN where the scan does not show it
  Eigen::Vector3d mm_per_Hz = Eigen::Vector3d::Zero(); // d_s
};

// The imaged point of each of `reference` reference points.
[[nodiscard]] PhantomScan phantom_scan(const MatchResult &match, Eigen::Index reference,
                                       const geometry::Points3 &imaged_mm, const Eigen::Vector3d &mm_per_Hz);
// The reference in the frame of the scans: rigidly, by least squares, on the points that all of them show, on average
// over them. Nothing for fewer than three such points.
[[nodiscard]] std::optional<geometry::Points3> place_reference(const geometry::Points3 &reference_mm,
                                                               std::span<const PhantomScan> scans);

// How a scan lies against the first one in what B0 cannot do: along the directions perpendicular to every d_s the scans
// differ by the position of the table, and by steps between slices that are not as stated.
struct ScanPlacement {
  Eigen::Vector3d shift_mm = Eigen::Vector3d::Zero();
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero(); // imaged_s - imaged_0 = shift + slope true
};
// One per scan, that of the first is zero; by least squares over the points that both show. Zero as well where d_s has
// all directions, or fewer than 12 points are shown by both.
[[nodiscard]] std::vector<ScanPlacement> relative_placements(const geometry::Points3 &true_mm,
                                                             std::span<const PhantomScan> scans);
// The scan as it would be without it.
[[nodiscard]] PhantomScan without(const ScanPlacement &placement, const geometry::Points3 &true_mm, PhantomScan scan);

struct SeparationOptions {
  int max_iterations = 300;
  double tolerance_mm = 1e-3; // largest change of a point by B0
};

struct SeparatedField {
  DistortionField gradients;
  HarmonicSeries b0_Hz;
  int iterations = 0;
  double last_change_mm = 0.0;

  // For a scan with this d_s.
  [[nodiscard]] Eigen::Vector3d to_imaged(const Eigen::Vector3d &true_mm, const Eigen::Vector3d &mm_per_Hz) const;
  // No result where the iteration does not settle within 1e-6 mm.
  [[nodiscard]] std::optional<Eigen::Vector3d> to_true(const Eigen::Vector3d &imaged_mm,
                                                       const Eigen::Vector3d &mm_per_Hz) const;
};

// Otherwise a sentence: fewer than two scans, sizes that differ, scans that B0 displaces alike, too few points shown.
[[nodiscard]] tl::expected<SeparatedField, std::string> separate_fields(const geometry::Points3 &true_mm,
                                                                        std::span<const PhantomScan> scans,
                                                                        const SeparationOptions &options = {});

// Residuals (14) of [Tuna 2022] for points of a scan that took no part; NaN where there is no inverse, or no point.
[[nodiscard]] geometry::Points3 residuals(const SeparatedField &field, const geometry::Points3 &true_mm,
                                          const PhantomScan &scan);

} // namespace bregma::mri
