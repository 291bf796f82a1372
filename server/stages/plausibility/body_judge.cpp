#include "server/stages/plausibility/body_judge.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::server {
namespace {

constexpr double kResidualMemory = 0.3; // weight of the newest residual

} // namespace

void BodyJudge::refuse(wire::PlausibilityReason reason, double statistic, double threshold) noexcept {
  refusals_ += refused_ ? 0 : 1;
  if (!failed_) { // the first failed test of a frame names the reason
    refusal_ = {bregma_wire_PLAUSIBILITY_REFUSED, reason, statistic, threshold};
  }
  refused_ = failed_ = true;
  consistent_ = 0;
}

void BodyJudge::malformed(int markers) noexcept {
  failed_ = false;
  refuse(bregma_wire_IMPLAUSIBLE_MARKERS, markers, 3.0);
  failed_ = false; // no sample follows
}

void BodyJudge::frozen(std::int64_t repeated_ns, std::int64_t limit_ns) noexcept {
  if (repeated_ns >= limit_ns) {
    refuse(bregma_wire_IMPLAUSIBLE_FROZEN, 1e-6 * static_cast<double>(repeated_ns),
           1e-6 * static_cast<double>(limit_ns));
    failed_ = false; // no sample follows
  }
}

void BodyJudge::outside_volume(double statistic) noexcept {
  if (!(statistic <= 1.0)) {
    refuse(bregma_wire_IMPLAUSIBLE_VOLUME, statistic, 1.0);
  }
}

void BodyJudge::residual(double rms_mm, double expected_mm) noexcept {
  const double relative = rms_mm / expected_mm;
  residual_ += kResidualMemory * (relative * relative - residual_);
  if (!(residual_ <= kRefuseAbove * kRefuseAbove)) {
    refuse(bregma_wire_IMPLAUSIBLE_RESIDUAL, std::sqrt(residual_), kRefuseAbove);
    // A single large residual is forgotten within a few frames.
    residual_ = std::fmin(residual_, 2.0 * kRefuseAbove * kRefuseAbove);
  }
}

Motion BodyJudge::motion(const BodySample &sample) const noexcept {
  return track_.knows(sample.time_ns) ? track_.by_hand(sample) : Motion{};
}

Motion BodyJudge::displacement(const BodySample &sample) const noexcept {
  return track_.unseen_ns(sample.time_ns) > kUnseen_ns ? track_.from_rest(sample) : Motion{};
}

void BodyJudge::take(const BodySample &sample, const Motion &motion, wire::PlausibilityReason blamed) noexcept {
  const bool was_connected = connected_;
  if (blamed != bregma_wire_IMPLAUSIBLE_NONE) {
    if (connected_) {
      trusted_sample_ = track_.last();
      connected_ = false;
    } else {
      const double elapsed_s = 1e-9 * static_cast<double>(sample.time_ns - trusted_sample_.time_ns);
      const double scatter_mm = std::sqrt(Motion::kThreshold * (sample.variance_mm2 + trusted_sample_.variance_mm2));
      connected_ =
          (sample.point_mm - trusted_sample_.point_mm).norm() <= BodyTrack::kMaxSpeed_mm_s * elapsed_s + scatter_mm;
    }
    if (!connected_) {
      refuse(blamed, motion.statistic(), Motion::kThreshold);
    }
  }
  if (!track_.knows(sample.time_ns)) {
    connected_ = true;
  }
  if (!motion.excluded() && track_.knows(sample.time_ns)) {
    track_.update(sample);
  } else {
    track_.start(sample);
  }
  if (connected_ && !was_connected) {
    consistent_ = 0; // the frames before show another place
  }
  consistent_ = failed_ ? 0 : std::min(consistent_ + 1, kConsistentFrames);
  failed_ = false;
  refused_ = refused_ && !trusted();
}

void BodyJudge::confirm() noexcept {
  connected_ = true;
  refused_ = refused_ && !steady();
}

double BodyJudge::inflation() const noexcept { return residual_ > kInflateAbove * kInflateAbove ? residual_ : 1.0; }

Judgement BodyJudge::judgement() const noexcept {
  if (!trusted()) {
    return refusal_;
  }
  if (inflation() > 1.0) {
    return {bregma_wire_PLAUSIBILITY_INFLATED, bregma_wire_IMPLAUSIBLE_RESIDUAL, std::sqrt(residual_), kInflateAbove};
  }
  return {bregma_wire_PLAUSIBILITY_GOOD, bregma_wire_IMPLAUSIBLE_NONE, wire::kUnknown, wire::kUnknown};
}

} // namespace bregma::server
