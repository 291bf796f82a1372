// The patient's head as it really is: the segmented scalp plus what segmentation got wrong.
//
// The error is a smooth random field along the normal: neighbouring points err alike, as partial volume, swelling and
// smoothing do. Frame: Image, mm. Const after construction; threads may share it.
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
  // sigma_mm: of the field at a point; correlation_mm: distance at which the correlation has fallen to exp(-1/2).
  Head(const surface::TriangleMesh &scalp, double sigma_mm, double correlation_mm, std::uint64_t seed);

  // The middle and half the diagonal's reach of the segmented scalp: no point of it is further than radius_mm.
  [[nodiscard]] const Vector3d &centre_mm() const { return centre_; }
  [[nodiscard]] double radius_mm() const { return radius_; }
  [[nodiscard]] const Vector3d &nose_mm() const { return nose_; } // the most anterior point

  [[nodiscard]] surface::SurfacePoint closest(const Vector3d &point) const { return surface_.closest(point); }
  // True skin minus segmented skin, along the outward normal.
  [[nodiscard]] double skin_error_mm(const Vector3d &on_scalp) const;
  // The true skin where the segmented scalp is nearest to the point; the normal is the scalp's, averaged over the
  // size of a fingertip, so that it does not jump at edges of the mesh.
  struct Skin {
    Vector3d point_mm;
    Vector3d normal;
  };
  [[nodiscard]] Skin skin(const Vector3d &near) const;

  // The segmented scalp stands between the two.
  [[nodiscard]] bool blocks(const Vector3d &from, const Vector3d &to) const;
  // Where a ray from outside first meets the segmented scalp.
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
