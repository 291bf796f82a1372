// The part of a daemon's state that may be shown now. Only this file decides whether a value is current; views print
// its results and nothing else.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "algorithms/geometry/unknown.hpp"
#include "clients/cli/daemon_link.hpp"

namespace bregma::cli {

// The navigation loop publishes each tool tens of times per second, even without frames. After this time without a
// sample the last one is no longer current.
inline constexpr std::int64_t kToolSilent_ns = 500'000'000;

enum class Presence { kNever, kSilent, kAlive };

struct DaemonView {
  Presence presence = Presence::kNever;
  double silent_s = geometry::kUnknown; // since it last spoke
  std::string text;                     // "navigating"; "no daemon"; "SILENT for 12.3 s"
};
[[nodiscard]] DaemonView view_daemon(const Snapshot &snapshot, std::int64_t now_ns);

// The reason why a sample published at this time is no longer current; empty if it is current.
[[nodiscard]] std::string stale_text(const DaemonView &daemon, std::int64_t published_ns, std::int64_t now_ns);

// Values are NaN unless the pose is live (or "unverified", for a check touch) and the sample is current.
struct ToolView {
  std::string tool;
  std::string status;
  bool fresh = false;                                                              // the values are current
  double age_ms = geometry::kUnknown;                                              // since exposure, as of now
  double tip_mm[3] = {geometry::kUnknown, geometry::kUnknown, geometry::kUnknown}; // in Image (RAS)
  double speed_mm_s = geometry::kUnknown;
  double tre_rms_mm = geometry::kUnknown; // predicted, at the tip
  double tre_95_mm = geometry::kUnknown;  // longest semi-axis of the 95 % ellipsoid
  std::string trajectory;
  double distance_to_target_mm = geometry::kUnknown;    // as it was imaged
  double distance_to_predicted_mm = geometry::kUnknown; // to the target where the tissue model predicts it
  double lateral_mm = geometry::kUnknown;
  double angle_deg = geometry::kUnknown;
  double remaining_depth_mm = geometry::kUnknown;
  std::string nearest_structure;
  double nearest_mm = geometry::kUnknown;
};
[[nodiscard]] ToolView view_tool(const wire::NavigationState &state, const DaemonView &daemon, std::int64_t now_ns);

// Alarms that are not cleared, the most severe first.
[[nodiscard]] std::vector<wire::Alarm> standing_alarms(const Snapshot &snapshot);

// `bregma status`: the whole state as text and as JSON. NaN is null in JSON.
[[nodiscard]] std::string status_text(const Snapshot &snapshot, std::uint32_t domain, std::int64_t now_ns);
[[nodiscard]] nlohmann::json status_json(const Snapshot &snapshot, std::uint32_t domain, std::int64_t now_ns);

// `bregma watch`: a table that fits on a screen, one line, or one object. An empty tool shows all.
[[nodiscard]] std::string tools_table(const Snapshot &snapshot, std::string_view tool, std::int64_t now_ns);
[[nodiscard]] std::string watch_table(const Snapshot &snapshot, std::string_view tool, std::int64_t now_ns);
[[nodiscard]] std::string watch_line(const Snapshot &snapshot, std::string_view tool, std::int64_t now_ns);
[[nodiscard]] nlohmann::json watch_json(const Snapshot &snapshot, std::string_view tool, std::int64_t now_ns);

[[nodiscard]] nlohmann::json alarm_json(const wire::Alarm &alarm);
[[nodiscard]] std::string alarm_line(const wire::Alarm &alarm, std::int64_t now_ns);

} // namespace bregma::cli
