#include "server/stages/plausibility/frame_judge.hpp"

#include <algorithm>
#include <optional>

namespace bregma::server {
namespace {

// The tests of one body; true if it has a sample whose motion is to be tested.
bool test_alone(BodyJudge &judge, const BodyFrame &body, std::int64_t limit_ns) noexcept {
  switch (body.content) {
  case BodyFrame::Content::kHidden:
    return false;
  case BodyFrame::Content::kMalformed:
    judge.malformed(body.markers);
    return false;
  case BodyFrame::Content::kRepeated:
    judge.frozen(body.repeated_ns, limit_ns);
    return false;
  case BodyFrame::Content::kNew:
    break;
  }
  judge.outside_volume(body.volume);
  if (body.expected_residual_mm > 0.0) {
    judge.residual(body.residual_mm, body.expected_residual_mm);
  }
  return body.placed;
}

// A turn is the cause of a jump of the point, not the other way round.
wire::PlausibilityReason reason_of(const Motion &motion) noexcept {
  return !motion.excluded()                       ? bregma_wire_IMPLAUSIBLE_NONE
         : !(motion.turned <= Motion::kThreshold) ? bregma_wire_IMPLAUSIBLE_ROTATION
                                                  : bregma_wire_IMPLAUSIBLE_JUMP;
}

} // namespace

void FrameJudge::reset() noexcept {
  reference_.reset();
  tools_.fill({});
  guarded_ = latched_ = false;
}

void FrameJudge::guard(bool guarded) noexcept {
  guarded_ = guarded;
  latched_ = false;
  reference_.confirm();
  for (BodyJudge &tool : tools_) {
    tool.confirm();
  }
}

void FrameJudge::judge(const BodyFrame &reference, std::span<const BodyFrame> tools, std::int64_t limit_ns) noexcept {
  const bool reference_new = test_alone(reference_, reference, limit_ns);
  Motion reference_motion = reference_new ? reference_.motion(reference.sample) : Motion{};
  wire::PlausibilityReason reason = reason_of(reference_motion);
  if (reference_new && guarded_ && !reference_motion.excluded()) {
    reference_motion = reference_.displacement(reference.sample);
    reason = reference_motion.excluded() ? bregma_wire_IMPLAUSIBLE_DISPLACED : bregma_wire_IMPLAUSIBLE_NONE;
  }

  std::array<std::optional<Motion>, bregma_wire_MAX_TOOLS> motions{};
  int staying = 0;
  int jumping = 0;
  for (std::size_t i = 0; i < tools.size(); ++i) {
    const bool established = tools_[i].established(tools[i].sample.time_ns);
    if (test_alone(tools_[i], tools[i], limit_ns)) {
      motions[i] = tools_[i].motion(tools[i].sample);
      staying += established && !motions[i]->excluded() ? 1 : 0;
      jumping += established && motions[i]->excluded() ? 1 : 0;
    }
  }
  const bool camera_moved = staying > 0 && jumping == 0;
  const bool reference_blamed = reference_motion.excluded() && !camera_moved;
  if (reference_new) {
    reference_.take(reference.sample, reference_motion, reference_blamed ? reason : bregma_wire_IMPLAUSIBLE_NONE);
  }
  for (std::size_t i = 0; i < tools.size(); ++i) {
    if (motions[i]) {
      tools_[i].take(tools[i].sample, *motions[i],
                     reference_blamed ? bregma_wire_IMPLAUSIBLE_NONE : reason_of(*motions[i]));
    }
  }
  const Judgement now = reference_.judgement();
  // Malformed frames say nothing about where the reference is.
  if (guarded_ && !latched_ && now.plausibility == bregma_wire_PLAUSIBILITY_REFUSED &&
      now.reason != bregma_wire_IMPLAUSIBLE_MARKERS) {
    latched_for_ = now;
    latched_ = true;
  }
}

void FrameJudge::require_touch() noexcept {
  if (guarded_ && !latched_) {
    latched_ = true;
    latched_for_ = {bregma_wire_PLAUSIBILITY_REFUSED, bregma_wire_IMPLAUSIBLE_DISPLACED, wire::kUnknown,
                    wire::kUnknown};
  }
}

void FrameJudge::confirm(std::size_t tool) noexcept {
  latched_ = false;
  reference_.confirm();
  tools_[tool].confirm();
}

bool FrameJudge::reference_trusted() const noexcept {
  return guarded_ ? reference_.trusted() && !latched_ : reference_.steady();
}

bool FrameJudge::trusted(std::size_t tool) const noexcept {
  return reference_trusted() && (guarded_ ? tools_[tool].trusted() : tools_[tool].steady());
}

bool FrameJudge::steady(std::size_t tool) const noexcept { return reference_.steady() && tools_[tool].steady(); }

Judgement FrameJudge::reference_judgement() const noexcept {
  return latched_ && reference_.trusted() ? latched_for_ : reference_.judgement();
}

Judgement FrameJudge::judgement(std::size_t tool) const noexcept {
  const Judgement reference = reference_judgement();
  const Judgement own = tools_[tool].judgement();
  return reference.plausibility > own.plausibility ? reference : own; // refused above inflated above good
}

} // namespace bregma::server
