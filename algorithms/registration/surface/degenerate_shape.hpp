// Shapes that can turn or slide in themselves: plane, sphere, spheroid. Where one of them explains a cloud of points as
// well as a head does, the cloud does not determine a pose of the head, however well one pose fits.
//
// Fits are robust [Geman 1985], with a reach of three sigmas. distance_mm receives the signed distance of every point
// to the fitted shape, mm; for the spheroid to first order [Taubin 1991]. Pure functions; they do not allocate. Fewer
// than three points, or points in one place, give distances that may not be finite.
#pragma once

#include <span>

#include <Eigen/Core>

namespace bregma::registration {

void fit_plane(std::span<const Eigen::Vector3d> points_mm, std::span<double> distance_mm) noexcept;
void fit_sphere(std::span<const Eigen::Vector3d> points_mm, double sigma_mm, std::span<double> distance_mm) noexcept;
// The best of three fits that start as the sphere, with the axis along each principal direction of the points.
void fit_spheroid(std::span<const Eigen::Vector3d> points_mm, double sigma_mm, std::span<double> distance_mm) noexcept;

} // namespace bregma::registration
