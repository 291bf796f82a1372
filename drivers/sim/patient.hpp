// Where everything truly is: the head before the camera, the reference clamped beside it, the tools as they were made,
// the fiducials where they really stick. All that the navigation system has to find out, and never sees.
//
// Image is the head's anatomy. The error with which points were placed in the image is put on fiducials and landmarks:
// planned positions are the case's, true ones differ by limits.fle_image_mm and limits.landmark_sigma_mm (1-sigma a
// coordinate) times the scenario's scales. Every touch then errs by limits.fle_touch_mm on top.
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
  Vector3d tip_mm = Vector3d::Zero(); // as made, in the body; the nominal tip is the model's

  [[nodiscard]] T_ImageTool body(const T_ImageTip &T_image_tip) const {
    return {T_image_tip.rotation(), T_image_tip * Vector3d(-tip_mm)};
  }
  [[nodiscard]] T_ImageTip tip(const T_ImageTool &T_image_tool) const {
    return {T_image_tool.rotation(), T_image_tool * tip_mm};
  }
};

// The rotation that points a tool's axis along the direction and turns its markers towards facing as far as that lets.
[[nodiscard]] Quaterniond point_tool(const casefile::ToolModel &tool, const Vector3d &axis_direction,
                                     const Vector3d &facing);

struct Patient {
  // Throws std::invalid_argument for a case without a scalp or a reference.
  Patient(const casefile::Case &a_case, const PatientParameters &parameters, std::uint64_t seed);

  [[nodiscard]] const TrueTool *tool(std::string_view name) const;
  [[nodiscard]] Vector3d camera_mm() const { return T_tracker_image.inverse() * Vector3d::Zero(); } // in Image
  // The reference is knocked: it moves against the head by this, in the image's axes.
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
