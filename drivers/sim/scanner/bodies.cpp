#include "drivers/sim/scanner/bodies.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bregma::sim::scanner {

namespace {

// The paper's aquarium: 254 x 254 x 267 mm, the long side along the pillars.
const Vector3d kTankHalf_mm{127.0, 127.0, 133.5};
constexpr double kPillarHalf_mm = 2.0; // the coils are wound around the pillars
constexpr double kPillarLength_mm = 80.0;
constexpr double kBranchHalf_mm = 2.0;

// Part of a bar along one axis that is at a point, given its distances from the bar's axis.
double bar(double a, double b, double half, double ramp) { return inside(a, half, ramp) * inside(b, half, ramp); }

} // namespace

double Body::in_tank(const Vector3d &p_mm, double ramp_mm) const {
  return inside(p_mm.x(), tank_half_mm_.x(), ramp_mm) * inside(p_mm.y(), tank_half_mm_.y(), ramp_mm) *
         inside(p_mm.z(), tank_half_mm_.z(), ramp_mm);
}

Phantom::Phantom(const PhantomDesign &design)
    : Body(kTankHalf_mm.cwiseMax(Vector3d::Constant(0.5 * design.size_mm() + 15.0))), design_(design) {}

double Phantom::plastic(const Vector3d &p_mm, double ramp_mm) const {
  const double pitch = design_.pitch_mm();
  const double first = -0.5 * (design_.bars - 1) * pitch;
  const double half = 0.5 * design_.bar_mm;
  const double outer = 0.5 * design_.size_mm();
  if (p_mm.cwiseAbs().maxCoeff() > outer + ramp_mm) {
    return 0.0;
  }
  // Distance to the nearest bar's axis along each axis.
  std::array<double, 3> in{};
  double cube = 1.0;
  for (int d = 0; d < 3; ++d) {
    const double n = std::clamp(std::round((p_mm[d] - first) / pitch), 0.0, design_.bars - 1.0);
    in[static_cast<std::size_t>(d)] = inside(p_mm[d] - first - n * pitch, half, ramp_mm);
    cube *= inside(p_mm[d], outer, ramp_mm);
  }
  return cube * std::max({in[0] * in[1], in[1] * in[2], in[0] * in[2]});
}

std::vector<Vector3d> Phantom::crossings_mm() const {
  std::vector<Vector3d> out;
  const double middle = 0.5 * (design_.bars - 1);
  for (int k = 0; k < design_.bars; ++k) {
    for (int j = 0; j < design_.bars; ++j) {
      for (int i = 0; i < design_.bars; ++i) {
        out.emplace_back((Vector3d(i, j, k).array() - middle) * design_.pitch_mm());
      }
    }
  }
  return out;
}

std::vector<CoilDesign> frame_design() {
  struct Square {
    const char *name;
    std::array<Eigen::Vector2d, 4> at_mm;
    std::array<double, 4> top_mm, bottom_mm;
  };
  const std::array<Square, 3> squares{{
      {"outer", {{{-104, -98}, {102, -104}, {98, 104}, {-104, 86}}}, {{58, 52, 62, 55}}, {{-56, -60, -52, -62}}},
      {"mid", {{{-72, -66}, {74, -72}, {70, 74}, {-74, 52}}}, {{55, 60, 50, 58}}, {{-58, -52, -60, -50}}},
      {"inner", {{{-40, -36}, {42, -40}, {36, 42}, {-42, 26}}}, {{50, 56, 60, 54}}, {{-52, -58, -50, -56}}},
  }};
  std::vector<CoilDesign> out;
  for (const bool top : {true, false}) {
    for (const Square &square : squares) {
      for (std::size_t i = 0; i < 4; ++i) {
        const std::string group = std::string(square.name) + (top ? "-top" : "-bottom");
        out.push_back({group + "-" + std::to_string(i + 1), group,
                       Vector3d(square.at_mm[i].x(), square.at_mm[i].y(), (top ? square.top_mm : square.bottom_mm)[i]),
                       Vector3d::UnitZ(), 20});
      }
    }
  }
  const std::array<Vector3d, 5> tree{{{0, 0, 32}, {-26, -6, 14}, {24, 10, 8}, {8, -26, -12}, {-10, 26, -22}}};
  for (std::size_t i = 0; i < tree.size(); ++i) {
    out.push_back({"tree-" + std::to_string(i + 1), "tree", tree[i], Vector3d::UnitZ(), 16});
  }
  return out;
}

CoilShape shape_of(const CoilDesign &coil) {
  CoilShape out;
  out.turns = coil.turns;
  out.length_mm = 0.125 * coil.turns; // wire of 0.25 mm (AWG 30) in two layers
  return out;
}

RegistrationFrame::RegistrationFrame(const std::vector<CoilDesign> &coils) : Body(kTankHalf_mm) {
  for (const CoilDesign &coil : coils) {
    if (coil.group == "tree") {
      tree_mm_.push_back(coil.position_mm);
    } else if (coil.group.ends_with("-top")) {
      pillars_mm_.emplace_back(coil.position_mm.head<2>());
    }
  }
}

double RegistrationFrame::plastic(const Vector3d &p_mm, double ramp_mm) const {
  double out = 0.0;
  for (const Eigen::Vector2d &pillar : pillars_mm_) {
    const double dx = p_mm.x() - pillar.x();
    const double dy = p_mm.y() - pillar.y();
    if (std::abs(dx) < kPillarHalf_mm + ramp_mm && std::abs(dy) < kPillarHalf_mm + ramp_mm) {
      out = std::max(out, bar(dx, dy, kPillarHalf_mm, ramp_mm) * inside(p_mm.z(), kPillarLength_mm, ramp_mm));
    }
  }
  if (tree_mm_.empty() || std::abs(p_mm.z()) > 45.0) {
    return out;
  }
  const double radius = std::hypot(p_mm.x(), p_mm.y());
  if (radius > 45.0) {
    return out;
  }
  out = std::max(out, bar(p_mm.x(), p_mm.y(), kBranchHalf_mm, ramp_mm) * inside(p_mm.z(), 38.0, ramp_mm));
  for (const Vector3d &coil : tree_mm_) {
    const double reach = coil.head<2>().norm();
    if (std::abs(p_mm.z() - coil.z()) > kBranchHalf_mm + ramp_mm || reach < 1.0) {
      continue;
    }
    const Eigen::Vector2d along = coil.head<2>() / reach;
    const double x = p_mm.head<2>().dot(along);
    const double y = p_mm.y() * along.x() - p_mm.x() * along.y();
    out = std::max(out, bar(y, p_mm.z() - coil.z(), kBranchHalf_mm, ramp_mm) *
                            inside(x - 0.5 * (reach + kBranchHalf_mm), 0.5 * (reach + kBranchHalf_mm), ramp_mm));
  }
  return out;
}

std::vector<Rod> z_frame_design() {
  constexpr double kSide = 70.0, kUpright = 50.0, kInclined = 34.0, kEnd = 45.0;
  std::vector<Rod> out;
  for (int side = 0; side < 3; ++side) {
    const auto at = [&](double along, double z) {
      return side == 1 ? Vector3d(along, kSide, z) : Vector3d(side == 0 ? -kSide : kSide, along, z);
    };
    out.push_back({at(-kUpright, -kEnd), at(-kUpright, kEnd)});
    out.push_back({at(-kInclined, -kEnd), at(kInclined, kEnd)});
    out.push_back({at(kUpright, -kEnd), at(kUpright, kEnd)});
  }
  return out;
}

ZFrame::ZFrame(std::vector<Rod> rods) : Body(kTankHalf_mm), rods_(std::move(rods)) {}

double ZFrame::plastic(const Vector3d &p_mm, double ramp_mm) const {
  double tube = 0.0;
  for (const Rod &rod : rods_) {
    const Vector3d along = rod.to_mm - rod.from_mm;
    const double length = along.norm();
    const Vector3d d = p_mm - 0.5 * (rod.from_mm + rod.to_mm);
    const double axial = d.dot(along) / length;
    const double radial2 = d.squaredNorm() - axial * axial;
    const double outside = kRadius_mm + ramp_mm;
    if (radial2 < outside * outside) {
      tube = std::max(tube, inside(std::sqrt(std::max(0.0, radial2)), kRadius_mm, ramp_mm) *
                                inside(axial, 0.5 * length, ramp_mm));
    }
  }
  return 1.0 - tube;
}

Tank::Tank() : Body(kTankHalf_mm) {}

} // namespace bregma::sim::scanner
