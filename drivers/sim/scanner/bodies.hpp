// What lies in the simulated bore: the grid phantom and the registration frame of [Tuna 2022], each in its tank of
// water.
//
// A body answers how much water and how much plastic is at a place given in its own frame (mm). Edges are ramps as wide
// as the sampling, so that a sampled image holds the part of each voxel that is filled. Immutable; safe to share.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "algorithms/geometry/rigid3.hpp"
#include "drivers/sim/scanner/loop_field.hpp"

namespace bregma::sim::scanner {

namespace frame {
struct Device; // isocentre; x to the patient's left, y up, z towards the feet, for a patient on the back, head first
struct Body;   // of the phantom, or of the registration frame (which is the robot's base)
} // namespace frame

using Eigen::Vector3d;
using BodyPose = geometry::Rigid3<frame::Device, frame::Body>;

class Body {
public:
  virtual ~Body() = default;
  // Filled parts, 0 to 1, within ramp_mm of a point.
  [[nodiscard]] virtual double plastic(const Vector3d &p_mm, double ramp_mm) const = 0;
  [[nodiscard]] double water(const Vector3d &p_mm, double ramp_mm) const {
    const double tank = in_tank(p_mm, ramp_mm);
    return tank > 0.0 ? tank * (1.0 - plastic(p_mm, ramp_mm)) : 0.0;
  }

protected:
  explicit Body(const Vector3d &tank_half_mm) : tank_half_mm_(tank_half_mm) {}

private:
  [[nodiscard]] double in_tank(const Vector3d &p_mm, double ramp_mm) const;
  Vector3d tank_half_mm_;
};

// 1 inside |x| < half, 0 outside, linear over ramp_mm.
[[nodiscard]] inline double inside(double x, double half, double ramp_mm) {
  const double depth = (half - (x < 0.0 ? -x : x)) / ramp_mm + 0.5;
  return depth < 0.0 ? 0.0 : depth > 1.0 ? 1.0 : depth;
}

// Bars along all three axes through the nodes of a lattice: a cube of 171 mm whose squares are 15 mm wide has eleven
// bars of 21 / 11 mm each way, and 1,331 crossings. Others, such as a wider one, by their number of bars.
struct PhantomDesign {
  int bars = 11;
  double square_mm = 15.0;
  double bar_mm = 21.0 / 11.0;
  [[nodiscard]] double pitch_mm() const { return square_mm + bar_mm; }
  [[nodiscard]] double size_mm() const { return bars * bar_mm + (bars - 1) * square_mm; }
};

class Phantom final : public Body {
public:
  explicit Phantom(const PhantomDesign &design);
  [[nodiscard]] double plastic(const Vector3d &p_mm, double ramp_mm) const override;
  // Crossings of the bars' axes; x runs fastest.
  [[nodiscard]] std::vector<Vector3d> crossings_mm() const;

private:
  PhantomDesign design_;
};

struct CoilDesign {
  std::string name;  // "mid-top-1"
  std::string group; // "mid-top": switched together
  Vector3d position_mm = Vector3d::Zero();
  Vector3d axis = Vector3d::UnitZ(); // unit length
  int turns = 20;
};

// Twelve pillars along z in three squares, a coil near the top and the bottom of each, and a tree of five coils. The
// squares are not regular, so that their pattern names each coil whichever way the frame lies.
[[nodiscard]] std::vector<CoilDesign> frame_design();
[[nodiscard]] CoilShape shape_of(const CoilDesign &coil);

class RegistrationFrame final : public Body {
public:
  explicit RegistrationFrame(const std::vector<CoilDesign> &coils);
  [[nodiscard]] double plastic(const Vector3d &p_mm, double ramp_mm) const override;

private:
  std::vector<Eigen::Vector2d> pillars_mm_;
  std::vector<Vector3d> tree_mm_; // coils at the ends of horizontal branches from a trunk on the z axis
};

// Nine tubes of water in plastic: two upright and one inclined on three sides of a square, so that every slice across
// them shows where it cuts [Tuna 2022, its reference 24]. Ends of the tubes' axes in the frame's own frame (z along the
// upright ones).
struct Rod {
  Vector3d from_mm = Vector3d::Zero();
  Vector3d to_mm = Vector3d::Zero();
};
[[nodiscard]] std::vector<Rod> z_frame_design();

class ZFrame final : public Body {
public:
  static constexpr double kRadius_mm = 3.0;
  explicit ZFrame(std::vector<Rod> rods);
  [[nodiscard]] double plastic(const Vector3d &p_mm, double ramp_mm) const override;

private:
  std::vector<Rod> rods_;
};

// Water without anything in it: for micro-coils and spheres of another susceptibility.
class Tank final : public Body {
public:
  Tank();
  [[nodiscard]] double plastic(const Vector3d & /*p_mm*/, double /*ramp_mm*/) const override { return 0.0; }
};

} // namespace bregma::sim::scanner
