#include "drivers/sim/arm/scene_line.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <optional>

#include "base/checked_line.hpp"
#include "base/text.hpp"

namespace bregma::sim {

namespace {

constexpr std::size_t kPoseFields = 7;
constexpr std::uint64_t kMaxSceneTime_us = 4'000'000'000'000'000;

template <class Pose> void put_pose(std::string &out, const Pose &T) {
  const Eigen::Quaterniond &q = T.rotation();
  for (const double value :
       {T.translation().x(), T.translation().y(), T.translation().z(), q.w(), q.x(), q.y(), q.z()}) {
    std::array<char, 40> text{};
    out.append(",").append(text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr);
  }
}

template <class Pose> bool read_pose(const std::string_view *fields, Pose &out) {
  std::array<double, kPoseFields> v{};
  for (std::size_t i = 0; i < kPoseFields; ++i) {
    const auto value = base::parsed_number<double>(fields[i]);
    if (!value || !std::isfinite(*value)) {
      return false;
    }
    v[i] = *value;
  }
  const Eigen::Quaterniond q(v[3], v[4], v[5], v[6]);
  if (!(std::abs(q.norm() - 1.0) <= 1e-3)) {
    return false;
  }
  out = {q.normalized(), geometry::Vector3d(v[0], v[1], v[2])};
  return true;
}

} // namespace

std::string line_of(const Scene &scene) {
  std::string body = "scene," + std::to_string(scene.time_us);
  put_pose(body, scene.T_base_flange);
  put_pose(body, scene.T_base_image);
  return base::checked_line(body);
}

tl::expected<Scene, std::string_view> parse_scene(std::string_view line) {
  const auto body = base::checked_body(line, kMaxSceneLine);
  if (!body) {
    return tl::unexpected<std::string_view>("is damaged");
  }
  std::array<std::string_view, 2 + 2 * kPoseFields> fields;
  if (!base::split_fields(*body, fields) || fields[0] != "scene") {
    return tl::unexpected<std::string_view>("is no scene");
  }
  Scene out;
  const auto time_us = base::parsed_number<std::uint64_t>(fields[1]);
  if (!time_us || *time_us > kMaxSceneTime_us) {
    return tl::unexpected<std::string_view>("has no time");
  }
  out.time_us = *time_us;
  if (!read_pose(&fields[2], out.T_base_flange) || !read_pose(&fields[2 + kPoseFields], out.T_base_image)) {
    return tl::unexpected<std::string_view>("has a value that is no pose");
  }
  return out;
}

} // namespace bregma::sim
