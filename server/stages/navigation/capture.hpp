// Recordings with a tool: the mean of a touch, a trace of the skin, the poses of a pivot calibration.
// Used only on the navigation thread; no allocation, no exceptions.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "algorithms/geometry/pose_covariance.hpp"
#include "server/session/messages.hpp"

namespace bregma::server {

// The tip of one tool in one frame, in Reference, with its errors: that of the markers, independent per frame; that of
// the tip's calibration, common to all frames; and, for a tool of an arm beside the tracker, that of hand-eye, common
// to all touches.
struct TipInReference {
  geometry::Vector3d position_mm;
  geometry::Matrix3d marker_covariance;
  geometry::Matrix3d tip_covariance;
  geometry::Matrix3d common_covariance;
};

// kNotNew: the frame repeats an old pose or is too old to measure with.
enum class FrameContent : std::uint8_t { kTip, kToolHidden, kReferenceHidden, kNotCalibrated, kNotNew, kImplausible };

// Averages a tip that is held still.
class TouchCapture {
public:
  void start(const CaptureRequest &request) noexcept;
  [[nodiscard]] bool busy() const noexcept { return busy_; }
  [[nodiscard]] const wire::Name &tool() const noexcept { return request_.tool; }
  [[nodiscard]] wire::CaptureKind kind() const noexcept { return request_.kind; }

  // tip is read only with FrameContent::kTip.
  void add(FrameContent content, const TipInReference &tip, std::uint64_t frame, std::int64_t acquired_ns) noexcept;
  // The answer, once, if the window has ended at the given time.
  [[nodiscard]] std::optional<CaptureResult> finish(std::int64_t now_ns) noexcept;

private:
  // The motion test uses the means of parts of the window. The tip of a single frame scatters by the markers' noise,
  // which the long lever enlarges, even if the hand does not move.
  static constexpr std::int64_t kParts = 5;
  struct Part {
    geometry::Vector3d sum = geometry::Vector3d::Zero();
    std::uint32_t frames = 0;
  };
  [[nodiscard]] double motion_mm(const geometry::Vector3d &mean) const noexcept;

  CaptureRequest request_{};
  bool busy_ = false;
  std::array<Part, kParts> parts_;
  std::uint32_t used_ = 0;
  std::uint32_t window_frames_ = 0;
  std::uint32_t reference_hidden_ = 0;
  std::uint32_t not_new_ = 0;
  std::uint32_t implausible_ = 0;
  std::uint32_t not_calibrated_ = 0;
  std::uint64_t last_frame_ = 0;
  std::int64_t last_acquired_ns_ = 0;
  geometry::Matrix3d marker_sum_;
  geometry::Matrix3d tip_covariance_, common_covariance_;
};

// Takes a sample whenever the tip has moved by the spacing.
class SurfaceTrace {
public:
  void request(const TraceRequest &request) noexcept;
  [[nodiscard]] bool on(const wire::Name &tool) const noexcept;
  [[nodiscard]] std::optional<SurfaceSample> add(const TipInReference &tip, std::uint64_t frame,
                                                 std::int64_t acquired_ns) noexcept;

private:
  TraceRequest request_{};
  std::optional<geometry::Vector3d> last_;
};

} // namespace bregma::server
