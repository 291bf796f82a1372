#include "drivers/sim/faults.hpp"

#include <cmath>

#include "algorithms/geometry/unknown.hpp"
#include "idl/names.hpp"

namespace bregma::sim {

namespace {

std::int64_t ns_of_s(double seconds) { return std::llround(seconds * 1e9); }

bool momentary(FaultKind kind) {
  return kind == FaultKind::kReferenceBump || kind == FaultKind::kClockJump || kind == FaultKind::kBadSamples;
}

} // namespace

FaultSchedule::FaultSchedule(const std::vector<Fault> &faults) {
  for (const Fault &fault : faults) {
    entries_.push_back({fault, std::nullopt, false});
  }
}

void FaultSchedule::start(std::int64_t now_ns) { step_started("", now_ns); }

void FaultSchedule::step_started(std::string_view step, std::int64_t now_ns) {
  for (Entry &entry : entries_) {
    if (!entry.start_ns && entry.fault.step == step) {
      entry.start_ns = now_ns + ns_of_s(entry.fault.after_s);
    }
  }
}

bool FaultSchedule::Entry::lasts(std::int64_t time_ns) const {
  return start_ns && time_ns >= *start_ns && time_ns < *start_ns + ns_of_s(fault.duration_s);
}

bool FaultSchedule::occluded(std::string_view tool, std::int64_t time_ns) const {
  for (const Entry &entry : entries_) {
    if (entry.fault.kind == FaultKind::kOcclusion && entry.fault.tool == tool && entry.lasts(time_ns)) {
      return true;
    }
  }
  return false;
}

bool FaultSchedule::tracker_silent(std::int64_t time_ns) const {
  for (const Entry &entry : entries_) {
    if (entry.fault.kind == FaultKind::kTrackerSilent && entry.lasts(time_ns)) {
      return true;
    }
  }
  return false;
}

double FaultSchedule::rate_factor(std::string_view device, std::int64_t time_ns) const {
  double factor = 1.0;
  for (const Entry &entry : entries_) {
    if (entry.fault.kind == FaultKind::kFlood && entry.fault.device == device && entry.lasts(time_ns)) {
      factor *= entry.fault.factor;
    }
  }
  return factor;
}

const Fault *FaultSchedule::take_due(std::int64_t time_ns) {
  for (Entry &entry : entries_) {
    if (!entry.taken && momentary(entry.fault.kind) && entry.start_ns && time_ns >= *entry.start_ns) {
      entry.taken = true;
      return &entry.fault;
    }
  }
  return nullptr;
}

bool replaces(BadSample kind) { return kind != BadSample::kDuplicate && kind != BadSample::kUnknownDevice; }

wire::TrackerFrame spoiled(const wire::TrackerFrame &good, BadSample kind) {
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  wire::TrackerFrame bad = good;
  wire::TrackedTool &tool = bad.tools[0];
  switch (kind) {
  case BadSample::kNotFinite:
    tool.status = bregma_wire_TOOL_VISIBLE;
    tool.T_tracker_tool.translation_mm[0] = geometry::kUnknown;
    break;
  case BadSample::kNotARotation:
    tool.status = bregma_wire_TOOL_VISIBLE;
    tool.T_tracker_tool = {{1.5, 0.0, 0.0, 0.0}, {0.0, 0.0, 1600.0}};
    break;
  case BadSample::kTimeBackwards:
    bad.device_time_ns -= kSecond_ns;
    break;
  case BadSample::kTimeInFuture:
    bad.device_time_ns += 3600 * kSecond_ns;
    break;
  case BadSample::kUnknownDevice:
    (void)wire::set_name(bad.device, "Stranger");
    break;
  case BadSample::kUnknownTool:
    (void)wire::set_name(tool.tool, "Stranger");
    break;
  case BadSample::kMalformed:
    bad.tool_count = bregma_wire_MAX_TOOLS + 1;
    break;
  case BadSample::kDuplicate:
    break;
  }
  return bad;
}

} // namespace bregma::sim
