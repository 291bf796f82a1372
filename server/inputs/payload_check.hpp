// Checks of a single sample's contents, independent of earlier samples. Later stages do not check them again.
//
// Threads: any. No allocation, no exceptions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "idl/topics.hpp"

namespace bregma::inputs {

// Tolerance of a quaternion's norm. Single precision in a device's protocol causes errors of about 1e-7.
inline constexpr double kRotationTolerance = 1e-3;
// A covariance in single precision may claim a correlation a little beyond 1: of its square.
inline constexpr double kCorrelationTolerance = 1.001;
// Maximal coordinate inside an operating room.
inline constexpr double kMaxPosition_mm = 20'000.0;
inline constexpr std::int64_t kMinPeriod_ns = 200'000; // 5 kHz
inline constexpr std::int64_t kMaxPeriod_ns = 60'000'000'000;

// The tools of the case. Trivially copyable, so that it can be passed to a loop in a LatestValue.
struct KnownTools {
  bool any = true; // no case is loaded: every tool is accepted
  std::uint32_t count = 0;
  wire::Name names[bregma_wire_MAX_TOOLS] = {};

  [[nodiscard]] bool contains(std::string_view name) const noexcept;
};
// False if there are more than MAX_TOOLS names, or a name is too long for DDS messages.
[[nodiscard]] std::optional<KnownTools> known_tools(std::span<const std::string> names);

using Rejection = std::optional<wire::RejectReason>; // nullopt: accepted

// The first violated rule, in the order: malformed, not finite, not a rotation. A tool that is not known is ignored,
// with its values: the others of the frame are used.
[[nodiscard]] Rejection check_payload(const wire::TrackerFrame &sample, const KnownTools &tools) noexcept;
[[nodiscard]] Rejection check_payload(const wire::RobotState &sample, const KnownTools &tools) noexcept;
[[nodiscard]] Rejection check_payload(const wire::RobotMotionState &sample, const KnownTools &tools) noexcept;
[[nodiscard]] Rejection check_payload(const wire::RangeSample &sample, const KnownTools &tools) noexcept;
[[nodiscard]] Rejection check_payload(const wire::ForceSample &sample, const KnownTools &tools) noexcept;

// Contradictions between a visible tool's markers and its geometry. They refuse this tool in this frame, and no other.
enum class MarkerFault : std::uint8_t {
  kNone,
  kTooFew,       // fewer than three, or all of them on one line
  kForeign,      // used_markers has bits beyond the tool's markers
  kNotAll,       // TOOL_VISIBLE, but used_markers lacks one
  kAll,          // TOOL_PARTLY_VISIBLE, but used_markers has every one
  kNoCovariance, // a tool without markers must state the covariance of its pose
};
// markers: number of markers of the tool; 0: a tracker without markers.
[[nodiscard]] MarkerFault check_markers(const wire::TrackedTool &tool, std::size_t markers) noexcept;
[[nodiscard]] std::string_view describe(MarkerFault fault) noexcept;

// Text for messages: "not a rotation", "time backwards", ...
[[nodiscard]] std::string_view describe(wire::RejectReason reason) noexcept;

} // namespace bregma::inputs
