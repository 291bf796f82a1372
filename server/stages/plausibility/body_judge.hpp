// Plausibility of one tracked body, a tool or the reference, frame by frame.
//
// A body is trusted while its data pass four tests:
//   frozen    the pose repeats the last one to the bit, for longer than a pose may be live
//   volume    its position is outside the tracker's stated volume
//   residual  the fit to its markers is worse than their error allows: first the covariance is inflated
//   jump      it has moved, or turned, as no hand can (body_track.hpp)
//   displaced only for the reference: it rested, and is elsewhere after it was not seen
// A refused body is steady again after kConsistentFrames frames in a row that pass. It is trusted again only if it is
// also back: after a jump, what follows is as implausible as its first frame, until the body jumps to where a hand can
// have carried it from the last trusted place, or was not seen for a second. confirm() restores the trust at once.
//
// Pure and per body: attribution of a jump to tool, reference or camera is the caller's (frame_judge.hpp).
// One thread. No allocation, no exceptions.
#pragma once

#include <cstdint>

#include "idl/names.hpp"
#include "server/inputs/payload_check.hpp"
#include "server/stages/plausibility/body_track.hpp"

namespace bregma::server {

struct Judgement {
  wire::Plausibility plausibility = bregma_wire_PLAUSIBILITY_UNKNOWN;
  wire::PlausibilityReason reason = bregma_wire_IMPLAUSIBLE_UNKNOWN;
  double statistic = wire::kUnknown; // of the test named by reason
  double threshold = wire::kUnknown;
};

// For monitoring.
struct BodyReport {
  Judgement judgement;
  std::uint64_t refusals = 0;
  inputs::MarkerFault fault = inputs::MarkerFault::kNone; // of the last malformed frame
  std::uint32_t used_markers = 0;                         // in that frame
};

class BodyJudge {
public:
  static constexpr int kConsistentFrames = 10;
  // Residuals relative to the expected one: RMS over a few frames.
  static constexpr double kInflateAbove = 1.5;
  static constexpr double kRefuseAbove = 2.5;
  static constexpr std::int64_t kUnseen_ns = 100'000'000; // enough for a knock

  void reset() noexcept { *this = BodyJudge{}; }

  // The tests of one frame, in this order. After malformed(), or frozen() with repeated_ns > 0, no others are made.
  void malformed(int markers) noexcept; // by the input check: number of used markers
  void frozen(std::int64_t repeated_ns, std::int64_t limit_ns) noexcept;
  void outside_volume(double statistic) noexcept; // above 1: outside
  void residual(double rms_mm, double expected_mm) noexcept;
  // Motion to this sample; 0 if nothing is known of the body.
  [[nodiscard]] Motion motion(const BodySample &sample) const noexcept;
  // The same if the body rested while it was not seen, for longer than kUnseen_ns; else 0.
  [[nodiscard]] Motion displacement(const BodySample &sample) const noexcept;
  // A caller that blames this body for a motion beyond the threshold states the reason, else IMPLAUSIBLE_NONE.
  // A track that is not continued and not blamed (the frame of reference has moved) begins again.
  void take(const BodySample &sample, const Motion &motion, wire::PlausibilityReason blamed) noexcept;

  // A check touch has shown that the body is where it is shown.
  void confirm() noexcept;

  // The last frames pass, wherever the body came from. Enough for a check touch, which proves the rest.
  [[nodiscard]] bool steady() const noexcept { return consistent_ >= kConsistentFrames; }
  [[nodiscard]] bool trusted() const noexcept { return steady() && connected_; }
  [[nodiscard]] bool established(std::int64_t time_ns) const noexcept { return connected_ && track_.knows(time_ns); }
  // Factor on the covariance of the markers.
  [[nodiscard]] double inflation() const noexcept;
  [[nodiscard]] Judgement judgement() const noexcept;
  // Number of times that the body was refused.
  [[nodiscard]] std::uint64_t refusals() const noexcept { return refusals_; }

private:
  void refuse(wire::PlausibilityReason reason, double statistic, double threshold) noexcept;

  BodyTrack track_;
  bool connected_ = true;     // the present track began where a hand can have carried the body
  BodySample trusted_sample_; // the last one before a jump
  bool failed_ = false;       // a test of this frame
  bool refused_ = false;      // since the last trusted frame
  int consistent_ = kConsistentFrames;
  double residual_ = 1.0; // running mean of the squared relative residual
  Judgement refusal_;     // the last one
  std::uint64_t refusals_ = 0;
};

} // namespace bregma::server
