// A navigated insertion: a tool moves along a planned line in a guide, and the operator steers by the display. The
// operator steers the displayed tip to the plan, not the true one: the display's error becomes the true error.
//
//   align (over the entry, until the display was live long enough to correct) -> advance -> settle -> hold -> withdraw
//
// While the display is not live the hand stops and waits. Frame: Image, mm.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/sim/motion.hpp"
#include "drivers/sim/scenario.hpp"
#include "idl/topics.hpp"

namespace bregma::sim {

class GuidedInsertion {
public:
  struct Plan {
    Vector3d entry_mm, target_mm;
    double speed_mm_s;
    double hold_s;
    double standoff_mm; // height above the entry for the alignment
  };
  enum class Phase { kAlign, kAdvance, kSettle, kHold, kWithdraw, kDone };

  // misplaced_mm: initial offset of the guide from the planned line, before steering.
  GuidedInsertion(const Plan &plan, const Quaterniond &rotation, const OperatorParameters &parameters,
                  const Vector3d &misplaced_mm);

  // The displayed state of this tool.
  void see(const wire::NavigationState &state, std::int64_t now_ns);
  // To be called several times per tremor period.
  void advance(std::int64_t now_ns);

  [[nodiscard]] HandPose pose(std::int64_t time_ns) const;
  [[nodiscard]] Phase phase() const { return phase_; }
  // Offset of the held tool from the planned line.
  [[nodiscard]] const Vector3d &correction_mm() const { return correction_; }
  [[nodiscard]] Vector3d direction() const { return direction_; }
  [[nodiscard]] double waited_s() const { return waited_s_; } // uninterrupted time of waiting for the display
  [[nodiscard]] std::string why_waiting() const;

private:
  [[nodiscard]] bool display_is_live(std::int64_t now_ns) const;
  [[nodiscard]] Vector3d aim() const { return plan_.entry_mm + advance_mm_ * direction_; }
  void drive(double to_mm, double speed_mm_s, double elapsed_s, bool may_move);
  [[nodiscard]] bool at(double advance_mm) const;

  Plan plan_;
  Quaterniond rotation_;
  OperatorParameters parameters_;
  Vector3d direction_;
  double depth_mm_; // entry to target
  Phase phase_ = Phase::kAlign;
  double phase_s_ = 0.0; // time with a live display
  double advance_mm_;    // along the line; 0 at the entry
  double speed_mm_s_ = 0.0;
  Vector3d correction_;
  double waited_s_ = 0.0;
  std::int64_t seen_ns_ = 0;    // time of the last state
  std::int64_t steered_ns_ = 0; // time of the last live state
  wire::PoseStatus shown_ = bregma_wire_POSE_UNKNOWN;
  Vector3d tip_before_, tip_; // intended tip at the last two calls of advance
  std::int64_t before_ns_ = 0, now_ns_ = 0;
};

} // namespace bregma::sim
