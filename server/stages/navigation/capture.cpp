#include "server/stages/navigation/capture.hpp"

#include <cmath>

#include "server/stages/wire_values.hpp"

namespace bregma::server {

// A touch is valid if the tool was seen in at least half of the window's frames.
constexpr double kMinSeenShare = 0.5;
// Limit for the motion of a part's mean by marker noise, in RMS distances: exceeded with probability 0.001.
constexpr double kNoiseReach = 2.5;

void TouchCapture::start(const CaptureRequest &request) noexcept {
  request_ = request;
  busy_ = true;
  used_ = 0;
  parts_.fill({});
  window_frames_ = reference_hidden_ = not_new_ = implausible_ = not_calibrated_ = 0;
  marker_sum_.setZero();
  tip_covariance_.setZero();
}

void TouchCapture::add(FrameContent content, const TipInReference &tip, std::uint64_t frame,
                       std::int64_t acquired_ns) noexcept {
  if (!busy_ || acquired_ns < request_.start_ns || acquired_ns > request_.start_ns + request_.window_ns) {
    return;
  }
  ++window_frames_;
  reference_hidden_ += content == FrameContent::kReferenceHidden ? 1 : 0;
  not_new_ += content == FrameContent::kNotNew ? 1 : 0;
  implausible_ += content == FrameContent::kImplausible ? 1 : 0;
  not_calibrated_ += content == FrameContent::kNotCalibrated ? 1 : 0;
  if (content != FrameContent::kTip) {
    return;
  }
  const std::int64_t part = (acquired_ns - request_.start_ns) * kParts / (request_.window_ns + 1);
  parts_[static_cast<std::size_t>(part)].sum += tip.position_mm;
  ++parts_[static_cast<std::size_t>(part)].frames;
  ++used_;
  marker_sum_ += tip.marker_covariance;
  tip_covariance_ = tip.tip_covariance;
  common_covariance_ = tip.common_covariance;
  last_frame_ = frame;
  last_acquired_ns_ = acquired_ns;
}

std::optional<CaptureResult> TouchCapture::finish(std::int64_t now_ns) noexcept {
  if (!busy_ || now_ns <= request_.start_ns + request_.window_ns) {
    return std::nullopt;
  }
  busy_ = false;
  CaptureResult result{};
  result.id = request_.id;
  result.used_frames = static_cast<std::uint32_t>(used_);
  result.window_frames = window_frames_;
  result.frame = last_frame_;
  result.acquired_time_ns = last_acquired_ns_;
  if (window_frames_ == 0) {
    result.status = CaptureStatus::kNoFrames;
    return result;
  }
  if (not_calibrated_ > 0) {
    result.status = CaptureStatus::kNotCalibrated;
    return result;
  }
  if (used_ == 0 || used_ < kMinSeenShare * window_frames_) {
    const std::uint32_t unused = window_frames_ - used_;
    result.status = 2 * implausible_ > unused        ? CaptureStatus::kImplausible
                    : 2 * not_new_ > unused          ? CaptureStatus::kNotNew
                    : 2 * reference_hidden_ > unused ? CaptureStatus::kReferenceHidden
                                                     : CaptureStatus::kToolHidden;
    return result;
  }
  const double count = used_;
  Vector3d mean = Vector3d::Zero();
  for (const Part &part : parts_) {
    mean += part.sum / count;
  }
  result.motion_mm = motion_mm(mean);
  result.status = result.motion_mm <= request_.max_motion_mm ? CaptureStatus::kOk : CaptureStatus::kMoved;
  result.position_mm = array_of(mean);
  // Averaging over frames reduces the markers' noise, but not the error of the tip.
  result.covariance_mm2 = array_of(Matrix3d(marker_sum_ / (count * count) + tip_covariance_));
  result.common_mm2 = array_of(common_covariance_);
  return result;
}

double TouchCapture::motion_mm(const Vector3d &mean) const noexcept {
  const double noise_mm = std::sqrt(marker_sum_.trace() / used_); // RMS distance of one frame's tip
  double largest = 0.0;
  for (const Part &part : parts_) {
    if (part.frames > 0) {
      const double moved = (part.sum / part.frames - mean).norm();
      largest = std::max(largest, moved - kNoiseReach * noise_mm / std::sqrt(part.frames));
    }
  }
  return largest;
}

void SurfaceTrace::request(const TraceRequest &request) noexcept {
  request_ = request;
  last_.reset();
}

bool SurfaceTrace::on(const wire::Name &tool) const noexcept { return request_.on && same(request_.tool, tool); }

std::optional<SurfaceSample> SurfaceTrace::add(const TipInReference &tip, std::uint64_t frame,
                                               std::int64_t acquired_ns) noexcept {
  if (last_ && (tip.position_mm - *last_).norm() < request_.spacing_mm) {
    return std::nullopt;
  }
  last_ = tip.position_mm;
  SurfaceSample sample{};
  copy_name(sample.tool, request_.tool);
  sample.frame = frame;
  sample.acquired_time_ns = acquired_ns;
  sample.position_mm = array_of(tip.position_mm);
  sample.covariance_mm2 = array_of(Matrix3d(tip.marker_covariance + tip.tip_covariance));
  sample.common_mm2 = array_of(tip.common_covariance);
  return sample;
}

} // namespace bregma::server
