// Errors of a registration, measured against known points or a known pose.
//
// FRE, TRE and out-of-plane mean error: [Tuna 2022, eqs. 15-17]. E10cm: [NeuroGuide, eq. 1], with the improvement that
// its authors ask for. These are measurements; predictions without truth are in tre.hpp. An FRE is a consistency, never
// an accuracy. Pure, no allocation. Units: mm, rad.
#pragma once

#include <span>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::uncertainty {

using geometry::Matrix3d;
using geometry::Vector3d;
using AnyPose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

// sqrt(mean |t_j - T s_j|^2): eq. 15 (FRE) on the registered points, eq. 16 (TRE) on others. NaN for no points or lists
// of different lengths.
[[nodiscard]] double rms_distance_mm(const AnyPose &T_target_source, std::span<const Vector3d> source_mm,
                                     std::span<const Vector3d> target_mm) noexcept;

// mean |n . (t_j - T s_j)|, n the unit normal of the image plane in the target frame: eq. 17. NaN as above.
[[nodiscard]] double out_of_plane_mean_error_mm(const AnyPose &T_target_source, std::span<const Vector3d> source_mm,
                                                std::span<const Vector3d> target_mm, const Vector3d &normal) noexcept;

struct TenCentimetres {
  // As printed: RMSE over the coordinates of T_actual X and T_estimated X, with X = 100 mm along the source's x axis,
  // including the translations. It depends on the origin and on the direction of x.
  double as_published_mm = 0.0;
  // Maximum displacement of the end of a 100 mm tool by the rotation error alone, in closed form: a direction normal to
  // the error's axis moves by 2 * 100 mm * sin(angle / 2). The same in all frames.
  double worst_mm = 0.0;
  Vector3d worst_direction = Vector3d::UnitX(); // one of the worst directions, unit, in the source frame
  double mean_mm = 0.0;                         // RMS over all directions: sqrt(2/3) times the maximum
  double angle_rad = 0.0;                       // angle of the rotation error
};
[[nodiscard]] TenCentimetres ten_centimetre_error(const AnyPose &actual, const AnyPose &estimated) noexcept;

} // namespace bregma::uncertainty
