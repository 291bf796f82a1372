// The part of a daemon's state that may be shown now. Only this file decides whether a value is current; views print
// its results and nothing else.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "algorithms/geometry/unknown.hpp"
#include "clients/live/snapshot.hpp"

namespace bregma::cli {

enum class Presence { kNever, kSilent, kAlive };

struct DaemonView {
  Presence presence = Presence::kNever;
  double silent_s = geometry::kUnknown; // since it last spoke
  std::string text;                     // "navigating"; "no daemon"; "SILENT for 12.3 s"
  std::optional<std::int64_t> now_ns;   // present time on its clock
};
[[nodiscard]] DaemonView view_daemon(const live::Snapshot &snapshot, const live::Now &now);

// The reason why a sample of this age is no longer current; empty if it is current.
[[nodiscard]] std::string stale_text(const DaemonView &daemon, std::int64_t since_published_ns);

// Values are NaN unless the pose may be shown now: it is live (or "unverified", for a check touch), and its time is not
// over. The errors are those of now and not those of the publication.
struct ToolView {
  std::string tool;
  std::string status;
  std::uint64_t frame = 0;                  // of the source
  bool fresh = false;                       // the values are current
  double age_ms = geometry::kUnknown;       // since exposure, as of now
  double age_sigma_ms = geometry::kUnknown; // of the age at publication
  double remaining_ms = 0.0;                // the pose may be shown for this time
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
  double nearest_sigma_mm = geometry::kUnknown; // of nearest_mm, at publication; NaN: not stated
};
[[nodiscard]] ToolView view_tool(const live::Received<wire::NavigationState> &state, const DaemonView &daemon,
                                 const live::Now &now);

// Alarms that are not cleared, the most severe first.
[[nodiscard]] std::vector<wire::Alarm> standing_alarms(const live::Snapshot &snapshot);

// `bregma status`: the whole state as text and as JSON. NaN is null in JSON.
// The case is navigated by an arm: nothing measures whether the patient has moved.
inline constexpr std::string_view kNotTracked =
    "PATIENT NOT TRACKED: poses hold while the patient lies still; check touches expire";
[[nodiscard]] bool patient_not_tracked(const live::Snapshot &snapshot);

[[nodiscard]] std::string status_text(const live::Snapshot &snapshot, std::uint32_t domain, const live::Now &now);
[[nodiscard]] nlohmann::json status_json(const live::Snapshot &snapshot, std::uint32_t domain, const live::Now &now);

// `bregma watch`: a table that fits on a screen, one line, or one object. An empty tool shows all.
[[nodiscard]] std::string tools_table(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now);
[[nodiscard]] std::string watch_table(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now);
[[nodiscard]] std::string watch_line(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now);
[[nodiscard]] nlohmann::json watch_json(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now);

[[nodiscard]] nlohmann::json alarm_json(const wire::Alarm &alarm);
// daemon_now_ns: present time on the daemon's clock, if known.
[[nodiscard]] std::string alarm_line(const wire::Alarm &alarm, std::optional<std::int64_t> daemon_now_ns);
// Warnings about the connection, each with a newline: other daemons, clocks that differ. Empty: none.
[[nodiscard]] std::string connection_text(const live::Snapshot &snapshot);

} // namespace bregma::cli
