// The two frames of a patient's positions in files: RAS, which is Bregma's, and LPS, which is DICOM's, ITK's and that
// of most of Slicer's files. They differ by half a turn about the z axis, which is its own inverse.
#pragma once

#include <optional>
#include <string_view>

#include <Eigen/Core>

namespace bregma::casefile {

enum class Space { kRas, kLps };

[[nodiscard]] inline Eigen::Vector3d flipped(const Eigen::Vector3d &p) { return {-p.x(), -p.y(), p.z()}; }

[[nodiscard]] inline std::string_view name_of(Space space) { return space == Space::kRas ? "RAS" : "LPS"; }

// From the name alone: "RAS" or "LPS".
[[nodiscard]] inline std::optional<Space> space_named(std::string_view name) {
  return name == "RAS" ? std::optional(Space::kRas) : name == "LPS" ? std::optional(Space::kLps) : std::nullopt;
}

} // namespace bregma::casefile
