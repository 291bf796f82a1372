// Files of coordinates seldom state their unit. Data with a width that no head can have are refused; the message has
// the width and the unit that would explain it.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <Eigen/Core>

namespace bregma::casefile {

enum class LengthUnit { kMillimetre, kCentimetre, kMetre, kMicrometre };

[[nodiscard]] double mm_per(LengthUnit unit);
[[nodiscard]] std::string_view name_of(LengthUnit unit);
// "mm", "cm", "m", "um", or the word, such as "millimetres"; no result for another name.
[[nodiscard]] std::optional<LengthUnit> unit_named(std::string_view name);

// Limits of the width: the longest side of the bounding box.
struct SizeLimits {
  double smallest_mm = 0.0;
  double largest_mm = 0.0;
};
// A head, or a part of one that determines a pose: 40 mm is a patch around the nose, 25 a whole head in centimetres.
inline constexpr SizeLimits kHeadSize{40.0, 1000.0};
// Fiducials, landmarks and samples: closer together they do not determine the pose of a head.
inline constexpr SizeLimits kPointsSize{5.0, 1000.0};
// Clouds of any object.
inline constexpr SizeLimits kAnySize{0.0, 1e12};

// The longest side of the points' box; 0 without points.
[[nodiscard]] double width_mm(std::span<const Eigen::Vector3d> points_mm);

// Empty where the width is within the limits, otherwise the problem and its remedy. what: "the
// surface"; read_in: the unit that the file was read in; option: the option that sets it, for example "--target-units",
// or empty.
[[nodiscard]] std::string size_problem(std::span<const Eigen::Vector3d> points_mm, const SizeLimits &limits,
                                       LengthUnit read_in, std::string_view what, std::string_view option);

} // namespace bregma::casefile
