// The true geometry: the head in front of the camera, the reference clamped next to it, the tools as manufactured, and
// the fiducials at their true positions. The navigation system must estimate it and does not receive it.
//
// Image is the head's anatomy. The placement error of points in the image is applied to fiducials and landmarks:
// planned positions are those of the case. True ones differ by limits.fle_image_mm and limits.landmark_sigma_mm
// (standard deviations per coordinate) times the scenario's scales. Every touch adds an error of limits.fle_touch_mm.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "algorithms/geometry/rigid3.hpp"
#include "casefile/case.hpp"
#include "drivers/sim/head.hpp"
#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

namespace frame = geometry::frame;
using Eigen::Quaterniond;
using T_TrackerImage = geometry::Rigid3<frame::Tracker, frame::Image>;
using T_TrackerTool = geometry::Rigid3<frame::Tracker, frame::Tool>;
using T_ImageTool = geometry::Rigid3<frame::Image, frame::Tool>;
using T_ImageTip = geometry::Rigid3<frame::Image, frame::Tip>;
using T_ImageReference = geometry::Rigid3<frame::Image, frame::Reference>;

struct TrueTool {
  casefile::ToolModel model;
  Vector3d tip_mm = Vector3d::Zero(); // as manufactured, in the body; the nominal tip is that of the model

  [[nodiscard]] T_ImageTool body(const T_ImageTip &T_image_tip) const {
    return {T_image_tip.rotation(), T_image_tip * Vector3d(-tip_mm)};
  }
  [[nodiscard]] T_ImageTip tip(const T_ImageTool &T_image_tool) const {
    return {T_image_tool.rotation(), T_image_tool * tip_mm};
  }
};

// The rotation that aligns a tool's axis with the direction and then turns its markers towards `facing` as far as
// possible.
[[nodiscard]] Quaterniond point_tool(const casefile::ToolModel &tool, const Vector3d &axis_direction,
                                     const Vector3d &facing);

struct Patient {
  // Throws std::invalid_argument for a case without a scalp or a reference.
  Patient(const casefile::Case &a_case, const PatientParameters &parameters, std::uint64_t seed);

  [[nodiscard]] const TrueTool *tool(std::string_view name) const;
  [[nodiscard]] Vector3d camera_mm() const { return T_tracker_image.inverse() * Vector3d::Zero(); } // in Image
  // Displaces the reference relative to the head by this, in the image's axes.
  void bump_reference(const Vector3d &by_mm);

  Head head;
  T_TrackerImage T_tracker_image;
  T_ImageReference T_image_reference;
  std::vector<TrueTool> tools;                 // those of the case, in its order; the reference is one of them
  std::size_t reference = 0;                   // index in tools
  std::vector<casefile::NamedPoint> fiducials; // true
  std::vector<casefile::NamedPoint> landmarks; // true
};

} // namespace bregma::sim
