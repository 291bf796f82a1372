#include "server/stages/surface_scan/stage.hpp"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <exception>
#include <string>
#include <utility>

#include "casefile/case.hpp"
#include "idl/names.hpp"
#include "server/stages/host.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

constexpr std::int64_t kStalled_ns = 1'000'000'000;
constexpr std::int64_t kLossShown_ns = 2'000'000'000;

constexpr AlarmConditions::Kind kScanStalled{alarm::kScanStalled, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0,
                                             0};
constexpr AlarmConditions::Kind kScanLost{alarm::kScanLost, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0, 0};
constexpr AlarmConditions::Kind kScanInterrupted{alarm::kScanInterrupted, bregma_wire_SEVERITY_CRITICAL,
                                                 SessionEffect::kNone, 0, 0};

std::string interruption_text(SurfaceScan::Interruption interruption, const ScanRequest &request) {
  switch (interruption) {
  case SurfaceScan::Interruption::kArmReplaced:
    return wire::text(request.arm) + " was restarted or replaced: start the registration anew";
  case SurfaceScan::Interruption::kSensorReplaced:
    return wire::text(request.sensor) +
           " was restarted or replaced: check that it is the calibrated one, then stop the "
           "scan and start it again";
  case SurfaceScan::Interruption::kArmJumped:
    return wire::text(request.arm) + " jumped: look at it, then stop the scan and start it again";
  case SurfaceScan::Interruption::kNone:
    break;
  }
  return {};
}

} // namespace

void declare(base::ParameterSet &set, SurfaceScanParameters &p) {
  set.number("scan.rate_hz", &p.rate_hz, "Hz", 0, 200,
             "Rate of the stage that makes surface points from an arm's range sensor; 0: off.");
}

SurfaceScanStage::SurfaceScanStage(const SurfaceScanParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = parameters.rate_hz}), scan_(parameters.arm),
      alarms_(conditions), points_(context.link) {}

void SurfaceScanStage::connect(Inbox &inbox, FlangeRing &flanges, RangeRing &readings, ReferenceRing &references) {
  inbox_ = &inbox;
  flanges_ = &flanges;
  readings_ = &readings;
  references_ = &references;
}

void SurfaceScanStage::step(const Moment &now) noexcept {
  try {
    take(now);
    publish(now);
    watch(now);
  } catch (const std::exception &) { // out of memory: the scan ends, and says so by its silence
    scan_.request({});
  }
}

void SurfaceScanStage::take(const Moment &now) {
  xyz_mm_.clear(); // published in the last step
  covariance_mm2_.clear();
  time_ns_.clear();
  inbox_->take_each([&](const ScanRequest &request) {
    scan_.request(request);
    began_ns_ = now.utc_ns;
    lost_seen_ = flanges_->dropped() + readings_->dropped() + references_->dropped();
  });
  FlangeSample flange;
  while (flanges_->try_pop(flange)) {
    scan_.add(flange);
  }
  ReferenceSample reference;
  while (references_->try_pop(reference)) {
    scan_.add(reference);
  }
  RangeReading reading;
  while (readings_->try_pop(reading)) {
    scan_.add(reading, now.utc_ns);
  }
  while (const auto point = scan_.next(now.utc_ns)) {
    SurfaceSample sample{};
    copy_name(sample.tool, scan_.request().sensor);
    sample.frame = point->frame;
    sample.acquired_time_ns = point->time_ns;
    sample.position_mm = array_of(point->position_mm);
    sample.covariance_mm2 = array_of(point->independent_mm2);
    sample.common_mm2 = array_of(point->common_mm2);
    if (scan_.request().reads_tilted) {
      sample.towards_sensor = array_of(point->towards_sensor);
      sample.across = array_of(point->across);
    }
    (void)events.try_push(sample); // a full ring counts dropped values
    const Matrix3d whole = point->independent_mm2 + point->common_mm2;
    for (const double value : {point->position_mm.x(), point->position_mm.y(), point->position_mm.z()}) {
      xyz_mm_.push_back(static_cast<float>(value));
    }
    for (const double value : {whole(0, 0), whole(0, 1), whole(0, 2), whole(1, 1), whole(1, 2), whole(2, 2)}) {
      covariance_mm2_.push_back(static_cast<float>(value));
    }
    time_ns_.push_back(point->time_ns);
  }
}

// The points since the last step.
void SurfaceScanStage::publish(const Moment &now) {
  if (time_ns_.empty()) {
    return;
  }
  const auto fill = [](auto &to, auto &values) {
    to._maximum = to._length = static_cast<std::uint32_t>(values.size());
    to._buffer = values.data();
    to._release = false;
  };
  wire::SurfacePoints out{};
  copy_name(out.device, scan_.request().sensor);
  out.frame = ++frame_;
  out.device_time_ns = time_ns_.back();
  out.sent_time_ns = now.utc_ns;
  const bool beside_tracker = scan_.request().beside_tracker;
  (void)wire::set_name(out.frame_name, beside_tracker ? wire::view(scan_.request().reference) : casefile::kRobotBase);
  fill(out.xyz_mm, xyz_mm_);
  fill(out.covariance_mm2, covariance_mm2_);
  fill(out.time_ns, time_ns_);
  points_(out, now.utc_ns);
}

void SurfaceScanStage::watch(const Moment &now) {
  const std::string_view sensor = wire::view(scan_.request().sensor);
  const SurfaceScan::Counts &counts = scan_.counts();
  const auto interruption = scan_.on() ? scan_.interruption() : SurfaceScan::Interruption::kNone;
  const bool interrupted = interruption != SurfaceScan::Interruption::kNone;
  alarms_.update(kScanInterrupted, sensor, interrupted, interruption_text(interruption, scan_.request()), now.utc_ns);

  const std::int64_t progress_ns = std::max(began_ns_, scan_.placed_ns());
  const bool stalled = scan_.on() && !interrupted && now.utc_ns - progress_ns > kStalled_ns;
  char text[256];
  (void)std::snprintf(
      text, sizeof text,
      "the scan stands still: of %" PRIu64 " readings %" PRIu64 " are missing, %" PRIu64
      " out of the calibrated range; %" PRIu64 " values have no pose of the arm and %" PRIu64 " none of the reference",
      counts.readings, counts.missing, counts.out_of_range, counts.without_flange, counts.without_reference);
  alarms_.update(kScanStalled, sensor, stalled, text, now.utc_ns);

  const std::uint64_t rings = flanges_->dropped() + readings_->dropped() + references_->dropped() + events.dropped();
  const std::uint64_t lost = rings + counts.without_flange + counts.without_reference + counts.overflown;
  lost_ns_ = scan_.on() && lost > std::exchange(lost_seen_, lost) ? now.utc_ns : lost_ns_;
  (void)std::snprintf(text, sizeof text,
                      "values are lost: %" PRIu64 " without a pose of the arm, %" PRIu64
                      " without one of the reference, %" PRIu64 " in full tables",
                      counts.without_flange, counts.without_reference, rings + counts.overflown);
  alarms_.update(kScanLost, sensor, scan_.on() && lost_ns_ != 0 && now.utc_ns - lost_ns_ < kLossShown_ns, text,
                 now.utc_ns);
}

} // namespace bregma::server
