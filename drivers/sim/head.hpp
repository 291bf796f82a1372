// The patient's true head: the segmented scalp plus the error of the segmentation.
//
// The error is a smooth random field along the normal. Errors of neighbouring points are correlated, like those from
// partial volume, swelling and smoothing. Frame: Image, mm. Const after construction; threads may share it.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "algorithms/geometry/rigid3.hpp"
#include "algorithms/surface/surface_model.hpp"

namespace bregma::sim {

using geometry::Matrix3d;
using geometry::Vector3d;

class Head {
public:
  // sigma_mm: standard deviation at a point. correlation_mm: distance at which the correlation is exp(-1/2).
  Head(const surface::TriangleMesh &scalp, double sigma_mm, double correlation_mm, std::uint64_t seed);

  // Centre and radius of a sphere around the segmented scalp.
  [[nodiscard]] const Vector3d &centre_mm() const { return centre_; }
  [[nodiscard]] double radius_mm() const { return radius_; }
  [[nodiscard]] const Vector3d &nose_mm() const { return nose_; } // the most anterior point

  [[nodiscard]] surface::SurfacePoint closest(const Vector3d &point) const { return surface_.closest(point); }
  // True skin minus segmented skin, along the outward normal.
  [[nodiscard]] double skin_error_mm(const Vector3d &on_scalp) const;
  // The true skin at the closest point of the segmented scalp. The normal is that of the scalp, averaged over the size
  // of a fingertip, so that it is continuous at edges of the mesh.
  struct Skin {
    Vector3d point_mm;
    Vector3d normal;
  };
  [[nodiscard]] Skin skin(const Vector3d &near) const;

  // True if the segmented scalp lies between the two points.
  [[nodiscard]] bool blocks(const Vector3d &from, const Vector3d &to) const;
  // First intersection of a ray from outside with the segmented scalp.
  [[nodiscard]] std::optional<Vector3d> first_hit(const Vector3d &origin, const Vector3d &direction) const;
  // Distance from the scalp; negative inside.
  [[nodiscard]] double clearance_mm(const Vector3d &point) const { return surface_.closest(point).signed_mm; }

private:
  struct Wave {
    Vector3d k; // rad/mm
    double phase;
  };

  surface::SurfaceModel surface_;
  Vector3d centre_;
  double radius_ = 0.0;
  Vector3d nose_;
  double amplitude_ = 0.0;
  std::vector<Wave> waves_;
};

} // namespace bregma::sim
