// Conversion between names and poses in DDS messages and their C++ values. No other file converts them.
#pragma once

#include <algorithm>
#include <cstring>
#include <string>
#include <string_view>

#include "algorithms/geometry/rigid3.hpp"
#include "algorithms/geometry/unknown.hpp"
#include "idl/topics.hpp"

namespace bregma::wire {

inline constexpr std::size_t kNameLength = sizeof(Name) - 1; // bytes, without the NUL
using geometry::kUnknown;

// False, with name unchanged, if the text is too long: a name is never truncated.
[[nodiscard]] inline bool set_name(Name &name, std::string_view text) noexcept {
  if (text.size() > kNameLength) {
    return false;
  }
  std::memset(name, 0, sizeof(Name));
  text.copy(name, kNameLength);
  return true;
}

[[nodiscard]] inline bool is_terminated(const Name &name) noexcept {
  return std::memchr(name, 0, sizeof(Name)) != nullptr;
}

// Reads at most the array, terminated or not.
[[nodiscard]] inline std::string_view view(const Name &name) noexcept { return {name, strnlen(name, sizeof(Name))}; }
[[nodiscard]] inline std::string text(const Name &name) { return std::string(view(name)); }

// A message for users in a bounded string. A text that is too long ends with "...".
template <std::size_t N> void set_text(char (&out)[N], std::string_view message) noexcept {
  static_assert(N > 4);
  const std::size_t length = std::min(message.size(), N - 1);
  message.copy(out, length);
  if (length < message.size()) {
    std::memcpy(out + N - 4, "...", 3);
  }
  out[length] = '\0';
}

template <class Target, class Source> [[nodiscard]] Pose to_wire(const geometry::Rigid3<Target, Source> &T) noexcept {
  const auto &q = T.rotation();
  const auto &t = T.translation();
  return {{q.w(), q.x(), q.y(), q.z()}, {t.x(), t.y(), t.z()}};
}

// Precondition: the pose has passed the input check (finite, unit quaternion). The caller states the frames.
template <class Target, class Source>
[[nodiscard]] geometry::Rigid3<Target, Source> from_wire(const Pose &pose) noexcept {
  const auto &q = pose.rotation_wxyz;
  const auto &t = pose.translation_mm;
  return {Eigen::Quaterniond(q[0], q[1], q[2], q[3]), Eigen::Vector3d(t[0], t[1], t[2])};
}

// Entries of PoseCovariance are those of the upper triangle, row by row: 00 01 .. 05 11 12 .. 55.
[[nodiscard]] constexpr std::size_t upper_index(std::size_t row, std::size_t column) noexcept {
  return row * 6 - row * (row + 1) / 2 + column;
}

[[nodiscard]] inline Pose unknown_pose() noexcept {
  return {{kUnknown, kUnknown, kUnknown, kUnknown}, {kUnknown, kUnknown, kUnknown}};
}

} // namespace bregma::wire
