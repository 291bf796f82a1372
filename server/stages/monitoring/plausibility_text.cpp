#include "server/stages/monitoring/plausibility_text.hpp"

#include <algorithm>
#include <cstdio>

namespace bregma::server {
namespace {

const char *what(wire::PlausibilityReason reason) noexcept {
  switch (reason) {
  case bregma_wire_IMPLAUSIBLE_FROZEN:
    return "its pose repeats to the bit (ms";
  case bregma_wire_IMPLAUSIBLE_VOLUME:
    return "it is outside the tracker's stated volume (relative position";
  case bregma_wire_IMPLAUSIBLE_JUMP:
    return "it moved as no hand can (statistic";
  case bregma_wire_IMPLAUSIBLE_ROTATION:
    return "it turned as no hand can, is it mirrored or transposed? (statistic";
  case bregma_wire_IMPLAUSIBLE_DISPLACED:
    return "it is not where it was before it was hidden (statistic";
  case bregma_wire_IMPLAUSIBLE_RESIDUAL:
    return "its markers do not fit its geometry (residual / expected";
  default:
    return "its data are implausible (statistic";
  }
}

} // namespace

void describe(const BodyReport &report, const BodyName &name, char (&text)[256]) noexcept {
  const auto length = [](std::string_view view) { return static_cast<int>(view.size()); };
  int used = std::snprintf(text, sizeof text, "%.*s of %.*s is refused: ", length(name.body), name.body.data(),
                           length(name.tracker), name.tracker.data());
  used = std::clamp(used, 0, static_cast<int>(sizeof text) - 1);
  char *const rest = text + used;
  const std::size_t left = sizeof text - static_cast<std::size_t>(used);
  const Judgement &judgement = report.judgement;
  if (judgement.reason == bregma_wire_IMPLAUSIBLE_DISPLACED && !(judgement.statistic >= 0.0)) { // not measured
    (void)std::snprintf(rest, left,
                        "the arm was restarted or replaced, or its tool changed; check a landmark, to show "
                        "that tip and base are where they were");
    return;
  }
  if (judgement.reason == bregma_wire_IMPLAUSIBLE_MARKERS) {
    const std::string_view fault = inputs::describe(report.fault);
    (void)std::snprintf(rest, left, "used_markers = 0x%x, %.*s", report.used_markers, length(fault), fault.data());
    return;
  }
  (void)std::snprintf(rest, left, "%s %.3g, limit %.3g)%s", what(judgement.reason), judgement.statistic,
                      judgement.threshold,
                      name.is_reference ? "; check a landmark, to show that it has not moved against the head"
                                        : "; hide it for a second or check a landmark with it, if it does not end");
}

} // namespace bregma::server
