// An optical tracker with realistic errors: markers have noise, and poses are fitted to them.
//
// Each visible marker is measured with normal noise in the tracker's frame, across and along the line of sight. The
// pose is the unweighted least-squares fit [Arun 1987] to the visible markers. So rotation and translation errors are
// correlated and increase when markers are lost, as in real trackers. A marker is lost if the tool is turned too far
// from the camera, if the head occludes it, if it is outside the measuring volume, or if a hand covers the tool.
//
// Noise is drawn for every marker, visible or not, so that an occlusion does not change the noise of the others.
// No allocation while measuring. Times ns.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "drivers/sim/patient.hpp"
#include "drivers/sim/random.hpp"
#include "idl/topics.hpp"

namespace bregma::sim {

// The device's own clock: offset, drift, jitter of the stamps, and jumps.
class DeviceClock {
public:
  DeviceClock(const TrackerParameters &parameters, std::uint64_t seed);
  // Host times from the start on, in order.
  [[nodiscard]] std::int64_t stamp(std::int64_t host_ns);
  void jump(std::int64_t by_ns) { offset_ns_ += by_ns; }

private:
  double drift_;
  double jitter_ns_;
  std::int64_t offset_ns_;
  std::int64_t start_ns_ = 0;
  bool started_ = false;
  Random random_;
};

class OpticalTracker {
public:
  OpticalTracker(const Patient &patient, const TrackerParameters &parameters, std::uint64_t seed);

  // Measures one tool. covered: a hand covers it.
  [[nodiscard]] wire::TrackedTool measure(const TrueTool &tool, const T_TrackerTool &T_tracker_tool, bool covered);

  // The head moves before the camera; at first it is where the patient has it.
  void place_head(const T_TrackerImage &T_tracker_image);

  struct Sight {
    std::uint32_t in_volume = 0; // bit i: marker i
    std::uint32_t seen = 0;      // in the volume, facing the camera, not occluded
  };
  [[nodiscard]] Sight look(const TrueTool &tool, const T_TrackerTool &T_tracker_tool) const;
  [[nodiscard]] bool in_volume(const Vector3d &in_tracker) const;

private:
  const Patient *patient_;
  TrackerParameters parameters_;
  geometry::Rigid3<frame::Image, frame::Tracker> T_image_tracker_;
  double cos_max_angle_, tan_half_width_, tan_half_height_;
  Random noise_;
};

} // namespace bregma::sim
