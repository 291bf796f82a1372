// A rigid straight probe: a cylinder with a hemispherical or conical tip. Lengths in the unit of the caller.
#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

namespace bregma::tissue {

enum class TipShape { kHemisphere, kCone };

struct ProbeShape {
  double radius_mm = 3.0; // [thesis, section 6.3.1]: 6 mm in diameter
  TipShape tip = TipShape::kHemisphere;
  double cone_half_angle_rad = 0.5;
};

struct ProbePose {
  Eigen::Vector3d tip_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d shaft = Eigen::Vector3d::UnitZ(); // unit, from the tip up the shaft
};

struct ProbeDistance {
  float signed_m = 0.0F;                             // negative inside the probe
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ(); // outward
};

// The probe in metres during one step, for the contacts.
struct PlacedProbe {
  Eigen::Vector3f tip_m = Eigen::Vector3f::Zero();
  Eigen::Vector3f shaft = Eigen::Vector3f::UnitZ();
  Eigen::Vector3f tip_velocity_m_s = Eigen::Vector3f::Zero();
  Eigen::Vector3f turning_per_s = Eigen::Vector3f::Zero(); // change of `shaft`
  float radius_m = 3e-3F;
  TipShape tip = TipShape::kHemisphere;
  float cone_sin = 0.0F, cone_cos = 1.0F; // sine and cosine of the half angle

  // Velocity of the probe at this height above the tip.
  [[nodiscard]] Eigen::Vector3f velocity_m_s(float height_m) const noexcept {
    return tip_velocity_m_s + height_m * turning_per_s;
  }

  [[nodiscard]] ProbeDistance distance(const Eigen::Vector3f &p) const noexcept {
    const Eigen::Vector3f from_tip = p - tip_m;
    const float height = from_tip.dot(shaft);
    const Eigen::Vector3f aside = from_tip - height * shaft;
    const float radius = aside.norm();
    // On the axis any perpendicular direction will do.
    const Eigen::Vector3f out = radius > 1e-9F ? Eigen::Vector3f(aside / radius) : shaft.unitOrthogonal();
    if (tip == TipShape::kHemisphere && height < radius_m) {
      const Eigen::Vector3f from_centre = from_tip - radius_m * shaft;
      const float length = from_centre.norm();
      return {length - radius_m, length > 1e-9F ? Eigen::Vector3f(from_centre / length) : Eigen::Vector3f(-shaft)};
    }
    const float cylinder = radius - radius_m;
    if (tip == TipShape::kCone) {
      const float cone = radius * cone_cos - height * cone_sin;
      if (cone > cylinder) {
        return {cone, cone_cos * out - cone_sin * shaft};
      }
    }
    return {cylinder, out};
  }
};

} // namespace bregma::tissue
