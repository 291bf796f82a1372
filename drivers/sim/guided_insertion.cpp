#include "drivers/sim/guided_insertion.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::sim {

namespace {

constexpr double kSpeedUp_s = 0.5; // time from rest to full speed
constexpr double kArrived_mm = 0.01;
constexpr double kMaxCorrection_mm_s = 4.0;
constexpr double kMaxStep_s = 0.05; // maximal steering step after a gap in the display
constexpr double kAlignTimes = 3.0; // steering time constants until the remainder is a twentieth
constexpr double kSettleTimes = 2.0;
constexpr double kWithdrawFaster = 2.0;

double seconds(std::int64_t from_ns, std::int64_t to_ns) { return static_cast<double>(to_ns - from_ns) * 1e-9; }

const char *name_of(wire::PoseStatus status) {
  switch (status) {
  case bregma_wire_POSE_LIVE:
    return "live";
  case bregma_wire_POSE_UNVERIFIED:
    return "unverified";
  case bregma_wire_POSE_STALE:
    return "stale";
  case bregma_wire_POSE_LOST:
    return "lost";
  case bregma_wire_POSE_TOOL_HIDDEN:
    return "tool hidden";
  case bregma_wire_POSE_REFERENCE_HIDDEN:
    return "reference hidden";
  case bregma_wire_POSE_NOT_CALIBRATED:
    return "not calibrated";
  case bregma_wire_POSE_NOT_REGISTERED:
    return "not registered";
  case bregma_wire_POSE_IMPLAUSIBLE:
    return "implausible";
  default:
    return "unknown";
  }
}

} // namespace

GuidedInsertion::GuidedInsertion(const Plan &plan, const Quaterniond &rotation, const OperatorParameters &parameters,
                                 const Vector3d &misplaced_mm)
    : plan_(plan), rotation_(rotation), parameters_(parameters),
      direction_((plan.target_mm - plan.entry_mm).normalized()), depth_mm_((plan.target_mm - plan.entry_mm).norm()),
      advance_mm_(-plan.standoff_mm), correction_(misplaced_mm), tip_before_(aim() + correction_), tip_(tip_before_) {}

bool GuidedInsertion::display_is_live(std::int64_t now_ns) const {
  return shown_ == bregma_wire_POSE_LIVE && seconds(seen_ns_, now_ns) <= parameters_.display_patience_s;
}

void GuidedInsertion::see(const wire::NavigationState &state, std::int64_t now_ns) {
  shown_ = state.status;
  seen_ns_ = now_ns;
  if (state.status != bregma_wire_POSE_LIVE) {
    return;
  }
  const auto &t = state.T_image_tip.translation_mm;
  const Vector3d shown(t[0], t[1], t[2]);
  const double step_s = steered_ns_ == 0 ? 0.0 : std::min(seconds(steered_ns_, now_ns), kMaxStep_s);
  steered_ns_ = now_ns;
  const bool steering = phase_ != Phase::kWithdraw && phase_ != Phase::kDone;
  if (steering && shown.allFinite()) {
    const Vector3d off = shown - aim();
    const double fastest = parameters_.steering_time_s * kMaxCorrection_mm_s;
    correction_ -= (step_s / parameters_.steering_time_s) * off * std::min(1.0, fastest / std::max(off.norm(), 1e-9));
  }
}

// Accelerates at a constant rate and brakes to stop at the goal.
void GuidedInsertion::drive(double to_mm, double speed_mm_s, double elapsed_s, bool may_move) {
  const double acceleration = speed_mm_s / kSpeedUp_s;
  const double left = to_mm - advance_mm_;
  const double wanted =
      may_move ? std::copysign(std::min(speed_mm_s, std::sqrt(2.0 * acceleration * std::abs(left))), left) : 0.0;
  speed_mm_s_ += std::clamp(wanted - speed_mm_s_, -2.0 * acceleration * elapsed_s, 2.0 * acceleration * elapsed_s);
  const double step = speed_mm_s_ * elapsed_s;
  advance_mm_ += std::abs(step) > std::abs(left) && may_move ? left : step;
}

bool GuidedInsertion::at(double advance_mm) const { return std::abs(advance_mm_ - advance_mm) < kArrived_mm; }

void GuidedInsertion::advance(std::int64_t now_ns) {
  const double elapsed_s = now_ns_ == 0 ? 0.0 : seconds(now_ns_, now_ns);
  const bool live = display_is_live(now_ns);
  const bool needs_display = phase_ != Phase::kWithdraw && phase_ != Phase::kDone;
  waited_s_ = live || !needs_display ? 0.0 : waited_s_ + elapsed_s;
  phase_s_ += live ? elapsed_s : 0.0;
  const auto enter = [this](Phase next) {
    phase_ = next;
    phase_s_ = 0.0;
  };
  switch (phase_) {
  case Phase::kAlign:
    if (phase_s_ >= kAlignTimes * parameters_.steering_time_s) {
      enter(Phase::kAdvance);
    }
    break;
  case Phase::kAdvance:
    drive(depth_mm_, plan_.speed_mm_s, elapsed_s, live);
    if (at(depth_mm_)) {
      enter(Phase::kSettle);
    }
    break;
  case Phase::kSettle:
    if (phase_s_ >= kSettleTimes * parameters_.steering_time_s) {
      enter(Phase::kHold);
    }
    break;
  case Phase::kHold:
    if (phase_s_ >= plan_.hold_s) {
      speed_mm_s_ = 0.0;
      enter(Phase::kWithdraw);
    }
    break;
  case Phase::kWithdraw:
    drive(-plan_.standoff_mm, kWithdrawFaster * plan_.speed_mm_s, elapsed_s, true);
    if (at(-plan_.standoff_mm)) {
      enter(Phase::kDone);
    }
    break;
  case Phase::kDone:
    break;
  }
  before_ns_ = now_ns_;
  now_ns_ = now_ns;
  tip_before_ = tip_;
  tip_ = aim() + correction_;
}

// Delayed by one call of advance(), so that the path is continuous between calls.
HandPose GuidedInsertion::pose(std::int64_t time_ns) const {
  const double between =
      before_ns_ == 0 ? 1.0 : std::clamp(seconds(now_ns_, time_ns) / seconds(before_ns_, now_ns_), 0.0, 1.0);
  return {tip_before_ + between * (tip_ - tip_before_), rotation_, parameters_.rest_share, parameters_.rest_share};
}

std::string GuidedInsertion::why_waiting() const {
  return "the display was not live for " + std::to_string(std::lround(waited_s_)) +
         " s (last shown: " + (seen_ns_ == 0 ? std::string("nothing") : std::string(name_of(shown_))) + ")";
}

} // namespace bregma::sim
