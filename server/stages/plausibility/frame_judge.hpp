// Plausibility of the bodies of a tracker's frame: between the input check and the navigation pipeline.
//
// The reference is judged in the frame of the tracker, the tools in that of the reference, because a camera may be
// moved. A jump of the reference is the camera's if every trusted tool stays where it was in Reference; otherwise it is
// the reference's, and not the tools'.
//
// A reference that was not seen for a moment and is then elsewhere may have been knocked by what hid it. The head and
// the camera rest, so once a registration is accepted, its displacement is refused like a jump.
//
// A refused tool is trusted again by itself (body_judge.hpp). A refused reference may have been knocked off the head,
// so once a registration is accepted, only a check touch ends it: confirm(). Before that nothing depends on it.
//
// One thread. No allocation, no exceptions.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "server/stages/plausibility/body_judge.hpp"

namespace bregma::server {

// What a frame contains of one body.
struct BodyFrame {
  enum class Content : std::uint8_t { kHidden, kMalformed, kRepeated, kNew };
  Content content = Content::kHidden;
  int markers = 0;              // used ones
  std::int64_t repeated_ns = 0; // time since the first frame with this pose; 0 for a new pose
  double volume = 0.0;          // position relative to the border of the tracker's volume; above 1: outside
  double residual_mm = 0.0;     // of the fit to the markers; 0 without markers
  double expected_residual_mm = 0.0;
  BodySample sample;   // only for a new pose: the reference in the tracker, a tool in Reference
  bool placed = false; // the sample is set; a tool has none while the reference is not seen
};

class FrameJudge {
public:
  // For another case.
  void reset() noexcept;
  // guarded: a registration is accepted. It proves tools and reference at its time.
  void guard(bool guarded) noexcept;

  // tools: in the order of the case. limit_ns: maximal age of a live pose.
  void judge(const BodyFrame &reference, std::span<const BodyFrame> tools, std::int64_t limit_ns) noexcept;

  // Something that nothing measured has changed the reference, such as another arm: like a refusal, once a registration
  // is accepted.
  void require_touch() noexcept;

  // A touch of a landmark was where it is expected.
  void confirm(std::size_t tool) noexcept;

  // What is measured against the reference may be used.
  [[nodiscard]] bool reference_trusted() const noexcept;
  // Poses of this tool may be shown and measured with.
  [[nodiscard]] bool trusted(std::size_t tool) const noexcept;
  // Good enough for a check touch.
  [[nodiscard]] bool steady(std::size_t tool) const noexcept;
  // Of the pose of a tool in Reference: the reference's, if that is refused.
  [[nodiscard]] Judgement judgement(std::size_t tool) const noexcept;
  // Of the reference alone, until a check touch confirms it.
  [[nodiscard]] Judgement reference_judgement() const noexcept;
  [[nodiscard]] const BodyJudge &reference() const noexcept { return reference_; }
  [[nodiscard]] const BodyJudge &tool(std::size_t index) const noexcept { return tools_[index]; }

private:
  BodyJudge reference_;
  std::array<BodyJudge, bregma_wire_MAX_TOOLS> tools_;
  bool guarded_ = false;
  bool latched_ = false;    // the reference was refused and not confirmed since
  Judgement latched_for_{}; // the first refusal
};

} // namespace bregma::server
