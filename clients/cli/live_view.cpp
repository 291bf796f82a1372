#include "clients/cli/live_view.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

#include "algorithms/geometry/angles.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/prediction_view.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"

namespace bregma::cli {
namespace {

double seconds(std::int64_t duration_ns) { return static_cast<double>(duration_ns) * 1e-9; }

// A smaller difference of the clocks is not worth a line: times of the daemon are shown relative to its own clock.
constexpr std::int64_t kClocksDiffer_ns = 1'000'000'000;

template <class Visit>
void each_tool(const live::Snapshot &snapshot, std::string_view wanted, const live::Now &now, Visit &&visit) {
  const DaemonView daemon = view_daemon(snapshot, now);
  for (const auto &[name, state] : snapshot.tools) {
    if (wanted.empty() || name == wanted) {
      visit(view_tool(state, daemon, now));
    }
  }
}

std::string tip_text(const ToolView &view) {
  return fixed(view.tip_mm[0], 1) + " " + fixed(view.tip_mm[1], 1) + " " + fixed(view.tip_mm[2], 1);
}

std::string nearest_text(const ToolView &view) {
  return std::isfinite(view.nearest_mm) ? view.nearest_structure + " " + fixed(view.nearest_mm, 1) : "-";
}

// The present step, and what was collected for it.
std::string step_text(const live::Snapshot &snapshot, const DaemonView &daemon) {
  std::string out = daemon.text;
  if (daemon.presence == Presence::kAlive && snapshot.registration) {
    out += ", " + std::to_string(snapshot.registration->fiducial_count) + " fiducials, " +
           std::to_string(snapshot.registration->surface_count) + " surface points";
  }
  if (daemon.presence == Presence::kAlive && snapshot.accuracy && snapshot.accuracy->check_count > 0) {
    out += ", " + std::to_string(snapshot.accuracy->check_count) + " check touches";
  }
  return out;
}

// The next step towards a live pose, where the state of the tool or of the session is the reason that there is none.
std::string_view missing_for_live(const wire::NavigationState &state) {
  switch (state.status) {
  case bregma_wire_POSE_UNVERIFIED:
    return "the registration is not verified: check the landmarks and confirm";
  case bregma_wire_POSE_NOT_CALIBRATED:
    return "its tip is not known: calibrate it by a pivot";
  case bregma_wire_POSE_NOT_REGISTERED:
    return "no registration is accepted";
  case bregma_wire_POSE_REFERENCE_HIDDEN:
    return "the tracker does not see the reference";
  case bregma_wire_POSE_TOOL_HIDDEN:
    return state.source_kind == bregma_wire_DEVICE_ROBOT ? "the arm does not carry it" : "the tracker does not see it";
  case bregma_wire_POSE_STALE:
  case bregma_wire_POSE_LOST:
    return "no recent frame of its source";
  case bregma_wire_POSE_IMPLAUSIBLE:
    return "the data of its source are implausible";
  default:
    return "";
  }
}

// One line per reason, for the tools that are not live.
std::string reasons_text(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now) {
  std::map<std::string, std::string> tools_of; // by reason
  const DaemonView daemon = view_daemon(snapshot, now);
  for (const auto &[name, state] : snapshot.tools) {
    const bool current = daemon.presence == Presence::kAlive &&
                         view_tool(state, daemon, now).status.starts_with(pose_label(state.status));
    if (const auto reason = missing_for_live(state); current && !reason.empty() && (tool.empty() || name == tool)) {
      std::string &tools = tools_of[std::string(reason)];
      tools += (tools.empty() ? "" : ", ") + printable(name);
    }
  }
  std::string out;
  for (const auto &[reason, tools] : tools_of) {
    out += "Not live: " + tools + ": " + reason + "\n";
  }
  return out;
}

// The only wording for the FRE: it measures the agreement of the fiducials, not the error at the target.
std::string consistency_text(const live::Snapshot &snapshot) {
  if (!snapshot.registration) {
    return "registration: no data";
  }
  const auto &registration = *snapshot.registration;
  std::string out = "registration " + std::string(registration_label(registration.status));
  if (std::isfinite(registration.fre_mm)) {
    out += ", fiducials consistent to " + fixed(registration.fre_mm, 2, "mm") + " (FRE; not an accuracy)";
  }
  // The reason of a refusal, or the next point to touch.
  if (registration.status == bregma_wire_REGISTRATION_REFUSED && *registration.text != '\0') {
    out += ": " + printable(registration.text);
  }
  return out;
}

} // namespace

bool patient_not_tracked(const live::Snapshot &snapshot) {
  return std::any_of(snapshot.tools.begin(), snapshot.tools.end(),
                     [](const auto &item) { return item.second.patient == bregma_wire_PATIENT_NOT_TRACKED; });
}

DaemonView view_daemon(const live::Snapshot &snapshot, const live::Now &now) {
  DaemonView out;
  if (!snapshot.health) {
    out.text = "no daemon";
    return out;
  }
  out.now_ns = live::daemon_now_ns(snapshot, now.boot_ns);
  out.silent_s = seconds(*live::silence_ns(snapshot, now.boot_ns));
  if (!live::alive(snapshot, now.boot_ns)) {
    out.presence = Presence::kSilent;
    out.text = "SILENT for " + duration_text(out.silent_s);
    return out;
  }
  out.presence = Presence::kAlive;
  out.text = session_label(snapshot.health->session);
  return out;
}

std::string stale_text(const DaemonView &daemon, std::int64_t since_published_ns) {
  if (daemon.presence != Presence::kAlive) {
    return "daemon silent";
  }
  return since_published_ns < live::kStateSilent_ns ? std::string()
                                                    : "no data for " + duration_text(seconds(since_published_ns));
}

ToolView view_tool(const live::Received<wire::NavigationState> &state, const DaemonView &daemon, const live::Now &now) {
  ToolView out;
  out.tool = printable(wire::view(state.tool));
  out.trajectory = printable(wire::view(state.trajectory));
  out.frame = state.frame;
  const auto age_ns = wire::age_ns(state, state.arrival, now.boot_ns);
  if (age_ns) {
    out.age_ms = static_cast<double>(*age_ns) * 1e-6;
    out.age_sigma_ms = state.age_sigma_ns > 0 ? static_cast<double>(state.age_sigma_ns) * 1e-6 : geometry::kUnknown;
  }
  const auto since_ns = wire::since_published_ns(state.arrival, now.boot_ns);
  out.status = stale_text(daemon, since_ns.value_or(now.boot_ns - state.arrival.boot_ns));
  if (!out.status.empty()) {
    return out;
  }
  const bool claims = state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED;
  const bool usable = wire::has_pose(state);
  out.status = claims && !usable ? "not usable" : pose_label(state.status);
  if (state.plausibility != bregma_wire_PLAUSIBILITY_UNKNOWN && state.plausibility != bregma_wire_PLAUSIBILITY_GOOD) {
    out.status += " (" + std::string(plausibility_label(state.plausibility_reason)) + ")";
  }
  if (!usable) {
    return out;
  }
  const std::int64_t remaining_ns = wire::remaining_ns(state, state.arrival, now.boot_ns);
  if (remaining_ns <= 0) {
    out.status = age_ns ? "too old" : "age not known";
    return out;
  }
  out.fresh = true;
  out.remaining_ms = static_cast<double>(remaining_ns) * 1e-6;
  const wire::TipError error = wire::tip_error(state, *since_ns);
  std::copy_n(state.T_image_tip.translation_mm, 3, out.tip_mm);
  out.speed_mm_s = std::hypot(state.velocity_mm_s[0], state.velocity_mm_s[1], state.velocity_mm_s[2]);
  out.tre_rms_mm = error.rms_mm;
  out.tre_95_mm = error.region_95.semi_axes_mm[0];
  if (!out.trajectory.empty()) {
    out.distance_to_target_mm = state.distance_to_target_mm;
    out.distance_to_predicted_mm = state.distance_to_predicted_target_mm;
    out.lateral_mm = state.lateral_deviation_mm;
    out.angle_deg = state.angle_rad / geometry::kRadiansPerDegree;
    out.remaining_depth_mm = state.remaining_depth_mm;
  }
  out.nearest_structure = printable(wire::view(state.nearest_structure));
  if (!out.nearest_structure.empty()) {
    out.nearest_mm = state.nearest_structure_mm;
    const double sigma_mm = state.nearest_structure_sigma_mm; // 0: a daemon of an earlier revision
    out.nearest_sigma_mm = sigma_mm > 0.0 ? sigma_mm : geometry::kUnknown;
  }
  return out;
}

std::vector<wire::Alarm> standing_alarms(const live::Snapshot &snapshot) {
  std::vector<wire::Alarm> out;
  for (const auto &[key, alarm] : snapshot.alarms) {
    if (alarm.state != bregma_wire_ALARM_CLEARED) {
      out.push_back(alarm);
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const auto &a, const auto &b) { return a.severity > b.severity; });
  return out;
}

std::string alarm_line(const wire::Alarm &alarm, std::optional<std::int64_t> daemon_now_ns) {
  std::string out = std::string(severity_label(alarm.severity)) + ": " + printable(wire::view(alarm.kind));
  if (!wire::view(alarm.subject).empty()) {
    out += " " + printable(wire::view(alarm.subject));
  }
  out += " (" + std::string(alarm_label(alarm.state));
  if (daemon_now_ns) {
    out += ", raised " + duration_text(seconds(*daemon_now_ns - alarm.raised_time_ns)) + " ago";
  }
  if (alarm.count > 1) {
    out += ", " + std::to_string(alarm.count) + " times";
  }
  out += ")";
  return *alarm.text == '\0' ? out : out + ": " + printable(alarm.text);
}

std::string connection_text(const live::Snapshot &snapshot) {
  std::string out;
  if (!snapshot.other_daemons.empty()) {
    out += "WARNING: " + snapshot.other_daemons + "\n";
  }
  if (snapshot.changes > 0) {
    out += "The daemon shown first was lost; this is another one\n";
  }
  if (const auto difference = snapshot.clock_difference_ns; difference && std::abs(*difference) >= kClocksDiffer_ns) {
    out += "Clock: this host's is " + duration_text(std::abs(seconds(*difference))) +
           (*difference > 0 ? " ahead of" : " behind") + " the daemon's; ages do not depend on it\n";
  }
  return out;
}

nlohmann::json alarm_json(const wire::Alarm &alarm) {
  return {{"kind", wire::text(alarm.kind)},
          {"subject", wire::text(alarm.subject)},
          {"state", alarm_label(alarm.state)},
          {"severity", severity_label(alarm.severity)},
          {"raised_time_ns", alarm.raised_time_ns},
          {"changed_time_ns", alarm.changed_time_ns},
          {"count", alarm.count},
          {"text", alarm.text}};
}

std::string tools_table(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now) {
  // Two tables of at most 80 columns: a wider one would be cut at the edge of a common terminal.
  Table poses({"Tool", "Status", "Tip R A S mm", "Age ms", "TRE 95 % mm"});
  Table plan({"Tool", "Target mm", "Predicted", "Lateral mm", "Angle deg", "Depth left", "Nearest mm"});
  each_tool(snapshot, tool, now, [&](const ToolView &view) {
    poses.row({view.tool, view.status, tip_text(view), fixed(view.age_ms, 1), fixed(view.tre_95_mm, 2)});
    if (!view.trajectory.empty() || std::isfinite(view.nearest_mm)) {
      plan.row({view.tool, fixed(view.distance_to_target_mm, 1), fixed(view.distance_to_predicted_mm, 1),
                fixed(view.lateral_mm, 2), fixed(view.angle_deg, 1), fixed(view.remaining_depth_mm, 1),
                nearest_text(view)});
    }
  });
  if (poses.empty()) {
    return tool.empty() ? "No tools yet\n" : "No tool '" + printable(tool) + "' yet\n";
  }
  return poses.text() + (plan.empty() ? "" : "\n" + plan.text());
}

std::string watch_table(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now) {
  const DaemonView daemon = view_daemon(snapshot, now);
  std::string out = "Session " + step_text(snapshot, daemon) + "\n";
  const std::string consistency = consistency_text(snapshot);
  out += "R" + consistency.substr(1) + "\n";
  out += patient_not_tracked(snapshot) ? std::string(kNotTracked) + "\n" : "";
  out += "\n" + tools_table(snapshot, tool, now);
  const std::string reasons = reasons_text(snapshot, tool, now);
  out += reasons.empty() ? "" : "\n" + reasons;
  for (const auto &[point, state] : snapshot.deformation) {
    const PredictionView view = view_prediction(state, daemon, now);
    out += view.fresh && state.phase != bregma_wire_PROBE_OUTSIDE ? "\nTissue  " + prediction_line(view) : "";
  }
  out += out.ends_with("\n") ? "" : "\n";
  out += snapshot.other_wire.empty() ? "" : "\nWire: " + snapshot.other_wire + "\n";
  const std::string connection = connection_text(snapshot);
  out += connection.empty() ? "" : "\n" + connection;
  const auto alarms = standing_alarms(snapshot);
  out += alarms.empty() ? "\nAlarms: none\n" : "\nAlarms:\n";
  for (const auto &alarm : alarms) {
    out += "  " + alarm_line(alarm, live::daemon_now_ns(snapshot, now.boot_ns)) + "\n";
  }
  return out;
}

std::string watch_line(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now) {
  std::string out = step_text(snapshot, view_daemon(snapshot, now));
  out += patient_not_tracked(snapshot) ? " | patient not tracked" : "";
  each_tool(snapshot, tool, now, [&](const ToolView &view) {
    out += " | " + view.tool + " " + view.status;
    if (view.fresh) {
      out += ", tip " + tip_text(view) + ", TRE 95 % " + fixed(view.tre_95_mm, 2, "mm");
    }
    if (std::isfinite(view.distance_to_target_mm)) {
      out += ", to target " + fixed(view.distance_to_target_mm, 1, "mm") + ", lateral " +
             fixed(view.lateral_mm, 2, "mm") + ", depth left " + fixed(view.remaining_depth_mm, 1, "mm");
    }
    if (std::isfinite(view.nearest_mm)) {
      out += ", nearest " + nearest_text(view) + " mm";
      out += std::isfinite(view.nearest_sigma_mm) ? " (1 sigma " + fixed(view.nearest_sigma_mm, 2, "mm") + ")" : "";
    }
  });
  for (const auto &alarm : standing_alarms(snapshot)) {
    out += " | " + alarm_line(alarm, live::daemon_now_ns(snapshot, now.boot_ns));
  }
  out += snapshot.other_daemons.empty() ? "" : " | WARNING: " + snapshot.other_daemons;
  return snapshot.other_wire.empty() ? out : out + " | wire: " + snapshot.other_wire;
}

nlohmann::json watch_json(const live::Snapshot &snapshot, std::string_view tool, const live::Now &now) {
  const DaemonView daemon = view_daemon(snapshot, now);
  const bool alive = daemon.presence == Presence::kAlive;
  const auto &difference = snapshot.clock_difference_ns;
  nlohmann::json out{{"time_ns", now.utc_ns},
                     {"boot_time_ns", now.boot_ns},
                     {"clock_difference_s", difference ? json_number(seconds(*difference)) : nlohmann::json()},
                     {"daemon_alive", alive},
                     {"silent_s", json_number(daemon.silent_s)},
                     {"session", alive ? nlohmann::json(daemon.text) : nlohmann::json()},
                     {"patient_not_tracked", patient_not_tracked(snapshot)},
                     {"other_daemons", snapshot.other_daemons},
                     {"daemon_changes", snapshot.changes},
                     {"other_wire", snapshot.other_wire},
                     {"tools", nlohmann::json::array()},
                     {"alarms", nlohmann::json::array()}};
  each_tool(snapshot, tool, now, [&](const ToolView &view) {
    out["tools"].push_back(
        {{"tool", view.tool},
         {"status", view.status},
         {"fresh", view.fresh},
         {"frame", view.frame},
         {"age_ms", json_number(view.age_ms)},
         {"age_sigma_ms", json_number(view.age_sigma_ms)},
         {"remaining_ms", json_number(view.remaining_ms)},
         {"tip_mm", {json_number(view.tip_mm[0]), json_number(view.tip_mm[1]), json_number(view.tip_mm[2])}},
         {"speed_mm_s", json_number(view.speed_mm_s)},
         {"tre_rms_mm", json_number(view.tre_rms_mm)},
         {"tre_95_mm", json_number(view.tre_95_mm)},
         {"trajectory", view.trajectory},
         {"distance_to_target_mm", json_number(view.distance_to_target_mm)},
         {"distance_to_predicted_target_mm", json_number(view.distance_to_predicted_mm)},
         {"lateral_deviation_mm", json_number(view.lateral_mm)},
         {"angle_deg", json_number(view.angle_deg)},
         {"remaining_depth_mm", json_number(view.remaining_depth_mm)},
         {"nearest_structure", view.nearest_structure},
         {"nearest_structure_mm", json_number(view.nearest_mm)},
         {"nearest_structure_sigma_mm", json_number(view.nearest_sigma_mm)}});
  });
  for (const auto &alarm : standing_alarms(snapshot)) {
    out["alarms"].push_back(alarm_json(alarm));
  }
  return out;
}

} // namespace bregma::cli
