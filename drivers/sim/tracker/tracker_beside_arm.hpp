// An optical tracker beside the simulated arm: a device of the driver frame, which sees what bregma-sim-arm states
// (drivers/sim/arm/scene_line.hpp): the bodies of a case, of which the reference is clamped beside the head, and one is
// fixed at the flange. The head moves before the camera; the camera and the arm's base do not.
//
// Errors and hidden markers are those of the simulated operating room (drivers/sim/optical_tracker.hpp). Links of the
// arm do not hide markers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "casefile/case.hpp"
#include "drivers/frame/byte_stream.hpp"
#include "drivers/frame/device.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/sim/arm/scene_line.hpp"
#include "drivers/sim/optical_tracker.hpp"
#include "drivers/sim/patient.hpp"

namespace bregma::sim {

// Where the camera and the body on the flange are.
struct TrackerPlace {
  Vector3d camera_direction{-0.2, 0.85, 0.45}; // from the head, in Image, when the first scene is seen
  double camera_distance_mm = 1600.0;
  // The body's origin in the flange; its normal points against the flange's z, so that it is seen from above.
  Vector3d body_mm{60.0, 40.0, -20.0};
};

// Pure: from a scene to a frame. One thread.
class TrackerBesideArm {
public:
  // body: the name of the one at the flange. Throws std::invalid_argument for a case without a scalp, a reference or
  // this body.
  TrackerBesideArm(const casefile::Case &a_case, const std::string &body, const TrackerPlace &place,
                   std::uint64_t seed);

  // The reference and the body. device_time_ns is the scene's, by the tracker's own clock; period_ns is not set.
  [[nodiscard]] wire::TrackerFrame measure(const Scene &scene);

  // Truth.
  [[nodiscard]] const geometry::Rigid3<frame::RobotFlange, frame::Tool> &T_flange_body() const {
    return T_flange_body_;
  }
  using BaseTracker = geometry::Rigid3<frame::RobotBase, frame::Tracker>;
  [[nodiscard]] const std::optional<BaseTracker> &T_base_tracker() const { return T_base_tracker_; }

private:
  Patient patient_;
  const TrueTool *body_;
  geometry::Rigid3<frame::RobotFlange, frame::Tool> T_flange_body_;
  std::optional<BaseTracker> T_base_tracker_; // from the first scene on
  DeviceClock clock_;
  OpticalTracker camera_;
  std::uint64_t frame_ = 0;
};

class TrackerDevice final : public driver::Device {
public:
  using Writes = driver::Topics<wire::TrackerFrame>;
  using Reads = driver::Topics<>;

  void declare(base::ParameterSet &parameters) override;
  [[nodiscard]] base::Result<void> prepare(const driver::Settings &settings) override;
  [[nodiscard]] driver::Outcome<void> connect(driver::Io &io) override;
  [[nodiscard]] driver::Outcome<driver::Progress> read(driver::Io &io) override;
  void disconnect() noexcept override { stream_.close(); }

private:
  std::string address_, case_, body_ = "Marker";
  std::int64_t seed_ = 1;
  std::optional<TrackerBesideArm> tracker_;
  driver::ByteStream stream_;
  driver::LineSplitter lines_{kMaxSceneLine};
};

} // namespace bregma::sim
