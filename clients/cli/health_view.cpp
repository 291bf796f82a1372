#include "clients/cli/health_view.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <numeric>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

#include "clients/cli/output.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"

namespace bregma::cli {

using nlohmann::json;

std::span<const wire::DeviceHealth> devices(const wire::SystemHealth &health) {
  return {health.devices, std::min<std::size_t>(health.device_count, std::size(health.devices))};
}

std::span<const wire::LoopHealth> loops(const wire::SystemHealth &health) {
  return {health.loops, std::min<std::size_t>(health.loop_count, std::size(health.loops))};
}

std::uint64_t rejected(const wire::DeviceHealth &device) {
  return std::accumulate(std::begin(device.rejected), std::end(device.rejected), std::uint64_t{0});
}

json device_figures_json(const wire::DeviceHealth &device) {
  json by_reason = json::object();
  for (std::size_t i = 0; i < std::size(device.rejected); ++i) {
    const std::string reason(reject_label(static_cast<wire::RejectReason>(i)));
    if (i > 0 && (reason != kNotKnownHere || device.rejected[i] > 0)) {
      by_reason[reason] = by_reason.value(reason, std::uint64_t{0}) + device.rejected[i];
    }
  }
  return {{"kind", device_kind_label(device.kind)},
          {"status", device_status_label(device.status)},
          {"rate_hz", json_number(device.rate_hz)},
          {"stated_rate_hz", json_number(device.stated_rate_hz)},
          {"transit_source", transit_source_label(device.transit_source)},
          {"latency_p50_ms", json_number(device.latency_p50_ms)},
          {"latency_p99_ms", json_number(device.latency_p99_ms)},
          {"taken", device.taken},
          {"rejected", rejected(device)},
          {"rejected_by_reason", std::move(by_reason)},
          {"malformed_bodies", device.malformed_bodies},
          {"other_writer", device.other_writer},
          {"lost", device.lost},
          {"late", device.late},
          {"clock_drift_ppm", json_number(device.clock_drift_ppm)},
          {"connections", device.connections}};
}

json loops_json(const wire::SystemHealth &health) {
  json out = json::array();
  for (const auto &loop : loops(health)) {
    out.push_back({{"loop", wire::text(loop.loop)},
                   {"rate_hz", json_number(loop.rate_hz)},
                   {"steps", loop.steps},
                   {"overruns", loop.overruns},
                   {"step_p50_us", json_number(loop.step_p50_us)},
                   {"step_p99_us", json_number(loop.step_p99_us)},
                   {"step_max_us", json_number(loop.step_max_us)}});
  }
  return out;
}

} // namespace bregma::cli
