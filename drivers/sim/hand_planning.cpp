#include "drivers/sim/hand_planning.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "algorithms/geometry/angles.hpp"

namespace bregma::sim {

namespace {

constexpr double kKnotSpacing_mm = 4.0;
constexpr std::size_t kKnotsPerGrip = 5;
constexpr double kClear_mm = 20.0;

struct Direction { // from the head's centre: azimuth 0 is anterior, positive to the right; elevation to superior
  double azimuth_deg, elevation_deg;
};

Vector3d unit(const Direction &d) {
  const double azimuth = d.azimuth_deg * geometry::kRadiansPerDegree;
  const double elevation = d.elevation_deg * geometry::kRadiansPerDegree;
  return {std::sin(azimuth) * std::cos(elevation), std::cos(azimuth) * std::cos(elevation), std::sin(elevation)};
}

// One round over a supine head: forehead back and forth, the nose, over the top from side to side, and back. kNose
// represents the tip of the nose.
constexpr Direction kNose{0, -90};
constexpr Direction kRound[] = {{-45, 28}, {0, 30},   {45, 28},  {45, 48}, {0, 42},  {0, 15},  kNose,   {0, 15},
                                {-50, 20}, {-80, 40}, {-85, 62}, {0, 85},  {85, 62}, {80, 40}, {55, 22}};

} // namespace

double HandPlanning::awkwardness(const TrueTool &tool, const HandPose &pose, const Vector3d &normal,
                                 const Quaterniond *like) const {
  const T_ImageTool body = tool.body({pose.rotation, pose.tip_mm});
  const Vector3d camera = patient_->camera_mm();
  const Vector3d shaft = -(pose.rotation * tool.model.axis.normalized());
  const double lean_deg = std::acos(std::clamp(shaft.dot(normal), -1.0, 1.0)) / geometry::kRadiansPerDegree;
  const Vector3d to_camera = (camera - body.translation()).normalized();
  const double turn_deg =
      std::acos(std::clamp((pose.rotation * tool.model.normal.normalized()).dot(to_camera), -1.0, 1.0)) /
      geometry::kRadiansPerDegree;
  double cost = std::pow(lean_deg / 60.0, 2) + std::pow(turn_deg / 50.0, 2);
  cost += turn_deg > 48.0 ? 5.0 + (turn_deg - 48.0) : 0.0; // markers are lost at 60
  if (like != nullptr) {
    cost += 1.5 * geometry::angle_between(*like, pose.rotation);
  }
  const Vector3d above = pose.tip_mm + 8.0 * normal + 8.0 * shaft;
  cost += patient_->head.blocks(above, body.translation()) ? 20.0 : 0.0;
  for (const auto &marker : tool.model.markers_mm) {
    cost += patient_->head.blocks(body * marker, camera) ? 10.0 : 0.0;
  }
  return cost;
}

HandPose HandPlanning::grip(const TrueTool &tool, const Vector3d &point, const Vector3d &normal,
                            const Quaterniond *like) const {
  const Vector3d side = normal.cross(std::abs(normal.z()) < 0.9 ? Vector3d::UnitZ() : Vector3d::UnitY()).normalized();
  const Vector3d other = normal.cross(side);
  HandPose best;
  double least = std::numeric_limits<double>::infinity();
  for (const double lean_deg : {0.0, 15.0, 30.0, 45.0, 60.0}) {
    const int around = lean_deg == 0.0 ? 1 : 12;
    for (int i = 0; i < around; ++i) {
      const double azimuth = 2.0 * std::numbers::pi * i / around;
      const Vector3d shaft =
          std::cos(lean_deg * geometry::kRadiansPerDegree) * normal +
          std::sin(lean_deg * geometry::kRadiansPerDegree) * (std::cos(azimuth) * side + std::sin(azimuth) * other);
      const Vector3d facing = patient_->camera_mm() - point;
      HandPose pose{point, point_tool(tool.model, -shaft, facing), parameters_.rest_share, 1.0};
      const double cost = awkwardness(tool, pose, normal, like);
      if (cost < least) {
        least = cost;
        best = pose;
      }
    }
  }
  return best;
}

HandPose HandPlanning::stand_off(const HandPose &touch, const Vector3d &normal) const {
  return {touch.tip_mm + parameters_.standoff_mm * normal, touch.rotation, 1.0, 1.0};
}

std::unique_ptr<Movement> HandPlanning::reach(const HandPose &from, const HandPose &to) const {
  const Head &head = patient_->head;
  const double wanted = std::min({kClear_mm, 0.9 * head.clearance_mm(from.tip_mm), 0.9 * head.clearance_mm(to.tip_mm)});
  const Vector3d middle = 0.5 * (from.tip_mm + to.tip_mm) - head.centre_mm();
  const Vector3d outward = middle.norm() > 20.0 ? Vector3d(middle.normalized())
                                                : Vector3d((patient_->camera_mm() - head.centre_mm()).normalized());
  const double most = 3.0 * head.radius_mm();
  for (double bow = 0.0;; bow += 10.0) {
    auto reach = std::make_unique<Reach>(from, to, parameters_.hand_speed_mm_s, Vector3d(bow * outward));
    bool clear = true;
    for (int i = 1; i < 24 && clear; ++i) {
      clear = head.clearance_mm(reach->position(i / 24.0)) > wanted;
    }
    if (clear || bow > most) {
      return reach;
    }
  }
}

std::vector<HandPose> HandPlanning::scalp_path(const TrueTool &tool, double length_mm) const {
  const Head &head = patient_->head;
  std::vector<Head::Skin> skin;
  double length = 0.0;
  const auto stop = [&head](std::size_t target) -> Vector3d {
    Direction direction = kRound[target % std::size(kRound)];
    if (direction.elevation_deg == kNose.elevation_deg) {
      return head.nose_mm();
    }
    direction.elevation_deg += 9.0 * static_cast<double>(target / std::size(kRound) % 3); // another line per round
    const Vector3d outward = unit(direction);
    const auto hit = head.first_hit(head.centre_mm() + 2.0 * head.radius_mm() * outward, -outward);
    return hit.value_or(head.closest(head.centre_mm() + head.radius_mm() * outward).point_mm);
  };
  skin.push_back(head.skin(stop(0)));
  for (std::size_t target = 1; length < length_mm; ++target) {
    const Vector3d goal = stop(target);
    // Moves along the tangent towards the goal and projects to the skin. The nose may be in between, so steps are
    // bounded.
    for (int step = 0; step < 100 && length < length_mm; ++step) {
      const Head::Skin &here = skin.back();
      const Vector3d to_goal = goal - here.point_mm;
      Vector3d along = to_goal - to_goal.dot(here.normal) * here.normal;
      if (to_goal.norm() < kKnotSpacing_mm || along.norm() < 0.5) {
        break;
      }
      along.normalize();
      skin.push_back(head.skin(here.point_mm + kKnotSpacing_mm * along));
      length += (skin.back().point_mm - skin[skin.size() - 2].point_mm).norm();
    }
  }
  std::vector<HandPose> knots;
  knots.reserve(skin.size());
  HandPose grip_before = grip(tool, skin.front().point_mm, skin.front().normal);
  for (std::size_t start = 0; start < skin.size(); start += kKnotsPerGrip) {
    const std::size_t end = std::min(start + kKnotsPerGrip, skin.size() - 1);
    const HandPose next = grip(tool, skin[end].point_mm, skin[end].normal, &grip_before.rotation);
    for (std::size_t i = start; i < std::min(start + kKnotsPerGrip, skin.size()); ++i) {
      const double way = static_cast<double>(i - start) / kKnotsPerGrip;
      knots.push_back({skin[i].point_mm, grip_before.rotation.slerp(way, next.rotation), parameters_.rest_share, 1.0});
    }
    grip_before = next;
  }
  return knots;
}

Vector3d HandPlanning::beside_head(double right_mm, double down_mm) const {
  const auto to_image = patient_->T_tracker_image.inverse().rotation();
  return patient_->head.centre_mm() + to_image * Vector3d(right_mm, down_mm, 0.0);
}

HandPose HandPlanning::in_stand(const TrueTool &tool, std::size_t place) const {
  const Vector3d tip = beside_head(280.0 + 90.0 * static_cast<double>(place), 100.0);
  const Vector3d down = patient_->T_tracker_image.inverse().rotation() * Vector3d::UnitY();
  return {tip, point_tool(tool.model, down, patient_->camera_mm() - tip), 0.0, 0.0};
}

HandPose HandPlanning::in_dimple(const TrueTool &tool) const {
  const Vector3d tip = beside_head(230.0, 0.0);
  const Vector3d down = patient_->T_tracker_image.inverse().rotation() * Vector3d::UnitY();
  return {tip, point_tool(tool.model, down, patient_->camera_mm() - tip), 0.0, 1.0};
}

} // namespace bregma::sim
