// Files of coordinates seldom say their unit. What is as wide as no head can be is refused, with the width that was
// seen and the unit that would explain it.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <Eigen/Core>

namespace bregma::casefile {

enum class LengthUnit { kMillimetre, kCentimetre, kMetre, kMicrometre };

[[nodiscard]] double mm_per(LengthUnit unit);
// "mm", "cm", "m", "um"; nothing for another name.
[[nodiscard]] std::optional<LengthUnit> unit_named(std::string_view name);

// How wide something may be, along the longest side of its box.
struct SizeLimits {
  double smallest_mm = 0.0;
  double largest_mm = 0.0;
};
// A head, or a part of one that fixes a pose: 40 mm is a patch about the nose, 25 a whole head in centimetres.
inline constexpr SizeLimits kHeadSize{40.0, 1000.0};
// Fiducials, landmarks and samples: closer together they fix no pose of a head.
inline constexpr SizeLimits kPointsSize{5.0, 1000.0};
// For clouds of anything.
inline constexpr SizeLimits kAnySize{0.0, 1e12};

// The longest side of the points' box; 0 without points.
[[nodiscard]] double width_mm(std::span<const Eigen::Vector3d> points_mm);

// Empty where the width lies within the limits, else what is wrong with it and what to do about it. what: "the
// surface"; read_in: the unit that the file was read in; option: the option that sets it, for example "--target-units".
[[nodiscard]] std::string size_problem(std::span<const Eigen::Vector3d> points_mm, const SizeLimits &limits,
                                       LengthUnit read_in, std::string_view what, std::string_view option);

} // namespace bregma::casefile
