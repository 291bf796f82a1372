// Errors of a registration as the seeds report them, measured against points or a pose that are known.
//
// FRE, TRE and out-of-plane mean error: the MRI paper's (15)-(17). E10cm: seed 002 eq. (1), with the improvement that
// its authors ask for. These are measurements; what is predicted without truth is in tre.hpp, and an FRE is a
// consistency, never an accuracy. Pure, no allocation. Units: mm, rad.
#pragma once

#include <span>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::uncertainty {

using geometry::Matrix3d;
using geometry::Vector3d;
using AnyPose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

// sqrt(mean |t_j - T s_j|^2): (15) on the points that were registered, (16) on others; it is the "RMSE at points not
// used". NaN for no points or lists of different lengths.
[[nodiscard]] double rms_distance_mm(const AnyPose &T_target_source, std::span<const Vector3d> source_mm,
                                     std::span<const Vector3d> target_mm) noexcept;

// mean |n . (t_j - T s_j)|, n the unit normal of the image's plane in the target frame: (17). NaN as above.
[[nodiscard]] double out_of_plane_mean_error_mm(const AnyPose &T_target_source, std::span<const Vector3d> source_mm,
                                                std::span<const Vector3d> target_mm, const Vector3d &normal) noexcept;

struct TenCentimetres {
  // As printed: RMSE over the coordinates of T_actual X and T_estimated X, X = 100 mm along the source's x axis, with
  // the translations. It depends on where the origin lies and on which way x points.
  double as_published_mm = 0.0;
  // How far the end of a 100 mm tool can be off through the rotation alone, in the worst direction, in closed form: the
  // direction normal to the axis of the error's rotation moves by 2 * 100 mm * sin(angle / 2). The same in all frames.
  double worst_mm = 0.0;
  Vector3d worst_direction = Vector3d::UnitX(); // one of them, unit, in the source frame
  double mean_mm = 0.0;                         // RMS over all directions: sqrt(2/3) of the worst
  double angle_rad = 0.0;                       // of the rotation's error
};
[[nodiscard]] TenCentimetres ten_centimetre_error(const AnyPose &actual, const AnyPose &estimated) noexcept;

} // namespace bregma::uncertainty
