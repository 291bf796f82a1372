// Stage surface scan: makes points on the skin from the flange poses of an arm and the readings of the range sensor
// that it carries (surface_scan.hpp), while the session has a scan running. The points go to the session, as those of a
// trace do, and are published as SurfacePoints. A worker, because SurfacePoints has sequences.
#pragma once

#include <cstdint>
#include <vector>

#include "base/parameters.hpp"
#include "server/runtime/mailbox.hpp"
#include "server/stages/monitoring/alarm_conditions.hpp"
#include "server/stages/navigation/pipeline.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/surface_scan/surface_scan.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct SurfaceScanParameters {
  double rate_hz = 50.0;
  ToolPoseOptions arm; // for an arm that states no covariance; set by the wiring from the parameters of robot tool
};
void declare(base::ParameterSet &set, SurfaceScanParameters &parameters);

class SurfaceScanStage final : public Stage {
public:
  static constexpr const char *kName = "surface scan";
  using Parameters = SurfaceScanParameters;
  using Inbox = runtime::Mailbox<ScanRequest, 16>;

  SurfaceScanStage(const SurfaceScanParameters &parameters, const StageContext &context);
  void connect(Inbox &inbox, FlangeRing &flanges, RangeRing &readings, ReferenceRing &references);

  void step(const Moment &now) noexcept override;

  NavigationEvents events; // SurfaceSample
  AlarmEvents conditions;

private:
  void take(const Moment &now);
  void publish(const Moment &now);
  void watch(const Moment &now);

  SurfaceScan scan_;
  AlarmConditions alarms_;
  Publisher<wire::SurfacePoints> points_;
  Inbox *inbox_ = nullptr;
  FlangeRing *flanges_ = nullptr;
  RangeRing *readings_ = nullptr;
  ReferenceRing *references_ = nullptr;
  std::vector<float> xyz_mm_, covariance_mm2_;
  std::vector<std::int64_t> time_ns_;
  std::uint64_t frame_ = 0;
  std::int64_t began_ns_ = 0;
  std::uint64_t lost_seen_ = 0;
  std::int64_t lost_ns_ = 0;
};

} // namespace bregma::server
