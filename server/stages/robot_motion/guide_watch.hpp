// What must go on to hold while an arm moves its guide along a path beside a tracker (guide_plan.hpp made the path),
// and where the guide is against the plan in the end.
//
// The path is one in RobotBase, planned by where the tracked patient was. It is void when the patient, the tracker or
// the arm's base has moved, and when nothing measures whether they have:
//
// - the head is within max_patient_mm of where it was, at each corner of its bounding box (mean of the latest frames);
// - the reference is plausible, and was seen when a live pose may have been taken: a frame or two without it end no
//   motion, since they leave the patient's place no older than a tracker that is silent for as long;
// - the hand-eye calibration is not contradicted, and was checked within kUncheckedMotion_ns;
// - the guide's pose is live, or only the reference is hidden.
//
// RobotBase, mm, rad, ns UTC. One thread; allocates.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "server/stages/robot_motion/patient_place.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

// Of the checks of hand-eye, before a motion and during it.
inline constexpr std::int64_t kUncheckedMotion_ns = 1'000'000'000;

// Why no path may be followed beside a tracker; empty: nothing prevents it. flange_body: name of the body that hand-eye
// is checked with; empty: none.
[[nodiscard]] std::string following_problem(const ReferenceView &reference, const std::string &flange_body,
                                            std::int64_t now_ns);
// The same for one that is to be planned: the reference is seen now.
[[nodiscard]] std::string planning_problem(const ReferenceView &reference, const std::string &flange_body,
                                           std::int64_t now_ns);

// The head as a box, in Reference.
using HeadCorners = std::array<geometry::Vector3d, 8>;

struct WatchedGuide {
  std::string tool, trajectory;
  // In Image: where the path puts the tip, and the direction from the entry to the target.
  geometry::Vector3d tip_mm = geometry::Vector3d::Zero();
  geometry::Vector3d direction = geometry::Vector3d::UnitZ();
  geometry::Vector3d axis = geometry::Vector3d::UnitZ(); // of the guide, in Tip
  // Beside a tracker: where the patient was, and how far he may move.
  std::optional<PatientPlace::Pose> T_base_reference;
  HeadCorners head{};
  std::string flange_body;
  double max_patient_mm = 0.0;
};

// Why the motion must stop; empty: it may go on. Without a tracker nothing is asked here: the driver's conditions do.
[[nodiscard]] std::string guide_problem(const WatchedGuide &guide, const PatientPlace &patient,
                                        const ReferenceView &reference, const TrackingView &tracking,
                                        std::int64_t now_ns);

// The largest displacement of a corner; infinite if one is not finite.
[[nodiscard]] double displacement_mm(const HeadCorners &head, const PatientPlace::Pose &from,
                                     const PatientPlace::Pose &to);

// The shown guide against the plan.
struct GuideEnd {
  bool live = false; // otherwise nothing is known
  double off_mm = 0.0, angle_rad = 0.0;
  double tre_95_mm = 0.0; // of the shown tip
};
[[nodiscard]] GuideEnd guide_end(const WatchedGuide &guide, const TrackingView &tracking);

} // namespace bregma::server
