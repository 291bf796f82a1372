// `bregma status`: prints the whole state once, as text or as JSON.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <span>

#include "casefile/session_file/growth.hpp"
#include "clients/cli/driver_view.hpp"
#include "clients/cli/health_view.hpp"
#include "clients/cli/live_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/prediction_view.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"
#include "idl/version.hpp"

namespace bregma::cli {
namespace {

using nlohmann::json;

std::span<const wire::TargetAccuracy> targets(const wire::AccuracyState &accuracy) {
  return {accuracy.targets, std::min<std::size_t>(accuracy.target_count, std::size(accuracy.targets))};
}

// Adds the time since the daemon stated the age.
double age_ms(const wire::DeviceHealth &device, const DaemonView &daemon) {
  return device.age_ms + daemon.silent_s * 1e3;
}

std::string case_text(const wire::SystemHealth &health) {
  return *health.case_folder == '\0' ? "no case loaded" : "case " + printable(health.case_folder);
}

std::string wire_text(const live::Snapshot &snapshot) {
  const auto &health = *snapshot.health;
  const wire::WireVersion daemon{health.wire_generation, health.wire_revision};
  std::string out = "Wire " + wire::text_of(daemon);
  out += daemon == wire::kWireVersion ? "" : ", this program " + wire::text_of(wire::kWireVersion);
  out += health.other_wire > 0 ? ", participants of another wire: " + std::to_string(health.other_wire) : "";
  out += snapshot.other_wire.empty() ? "\n" : "; " + snapshot.other_wire + "\n";
  out += *health.mismatches == '\0' ? "" : "Mismatch at the daemon: " + printable(health.mismatches) + "\n";
  out += snapshot.mismatches.empty() ? "" : "Mismatch at this program: " + printable(snapshot.mismatches) + "\n";
  return out + (health.ill_typed_samples == 0
                    ? ""
                    : "Samples that are not of their topic's type: " + std::to_string(health.ill_typed_samples) + "\n");
}

// Nothing if the daemon does not record, or does not state its disk.
std::optional<casefile::RecordingSpace> recording_space(const wire::SystemHealth &health) {
  const casefile::RecordingSpace space{health.recording_free_bytes, health.recording_bytes_per_s};
  return space.bytes_per_s > 0.0 ? std::optional(space) : std::nullopt;
}

std::string recorder_text(const wire::SystemHealth &health) {
  std::string out = "Recorder  " + std::to_string(health.recorded) + " samples recorded, " +
                    std::to_string(health.record_dropped) + " dropped" + (health.recorder_failing ? ", FAILING" : "");
  const auto space = recording_space(health);
  return out + (space ? "; " + space_text(*space) : "") + "\n";
}

json recorder_json(const wire::SystemHealth &health) {
  json out = {{"recorded", health.recorded}, {"dropped", health.record_dropped}, {"failing", health.recorder_failing},
              {"free_bytes", nullptr},       {"bytes_per_s", nullptr},           {"hours_left", nullptr}};
  if (const auto space = recording_space(health)) {
    out["free_bytes"] = space->free_bytes;
    out["bytes_per_s"] = json_number(space->bytes_per_s);
    out["hours_left"] = json_number(space->hours());
  }
  return out;
}

std::string registration_text(const live::Snapshot &snapshot) {
  if (!snapshot.registration) {
    return "Registration  no data\n";
  }
  const auto &state = *snapshot.registration;
  std::string out = "Registration  " + std::string(registration_label(state.status));
  if (state.status == bregma_wire_REGISTRATION_REFUSED) {
    out += ": " + std::string(refusal_label(state.reason));
    out += wire::view(state.subject).empty() ? "" : " (" + printable(wire::view(state.subject)) + ")";
  }
  out += state.accepted_revision > 0 ? ", revision " + std::to_string(state.accepted_revision) + " accepted" : "";
  out += *state.text == '\0' ? "\n" : "; " + printable(state.text) + "\n";
  out += "  from " + std::to_string(state.fiducial_count) + " fiducials and " + std::to_string(state.surface_count) +
         " surface points\n";
  if (std::isfinite(state.fre_mm)) {
    out += "  FRE " + fixed(state.fre_mm, 2, "mm") +
           ": consistency of the fiducials, not the error at the target; surface RMS " +
           fixed(state.surface_rms_mm, 2, "mm") + "\n";
  }
  return out;
}

std::string accuracy_text(const live::Snapshot &snapshot) {
  if (!snapshot.accuracy) {
    return "Accuracy  not known\n";
  }
  const auto &accuracy = *snapshot.accuracy;
  std::string out = "Accuracy  predicted target error (TRE)\n";
  Table table({"Target", "RMS mm", "95 % mm", "Of it from image mm"});
  for (const auto &target : targets(accuracy)) {
    table.row({printable(wire::view(target.target)), fixed(target.tre_rms_mm, 2),
               fixed(target.tre_95.semi_axes_mm[0], 2),
               target.image_rms_mm > 0.0 ? fixed(target.image_rms_mm, 2) : std::string("-")});
  }
  out += table.empty() ? "not known: no accepted registration\n" : table.text();
  if (accuracy.check_count > 0) {
    out += "Check touches " + std::to_string(accuracy.check_count) + ", the last " +
           fixed(accuracy.last_check_mm, 2, "mm") + " (95 % stay below " +
           fixed(accuracy.last_check_limit_mm, 2, "mm") + " if nothing has moved)\n";
  } else {
    out += "Check touches none\n";
  }
  out += "Drift " + std::string(accuracy.drift_detected ? "DETECTED" : "none detected") + " (statistic " +
         fixed(accuracy.drift_statistic, 2) + " of " + fixed(accuracy.drift_threshold, 2) + ")\n";
  return out;
}

std::string devices_text(const wire::SystemHealth &health, const DaemonView &daemon) {
  Table table({"Device", "Kind", "Status", "Rate Hz", "Age ms", "Latency p50 ms", "p99 ms", "Taken", "Rejected", "Lost",
               "Late", "Clock ms", "Drift ppm", "Connects"});
  std::string reasons;
  for (const auto &device : devices(health)) {
    const std::string name = printable(wire::view(device.device));
    table.row({name, std::string(device_kind_label(device.kind)), std::string(device_status_label(device.status)),
               fixed(device.rate_hz, 1), fixed(age_ms(device, daemon), 1), fixed(device.latency_p50_ms, 2),
               fixed(device.latency_p99_ms, 2), std::to_string(device.taken), std::to_string(rejected(device)),
               std::to_string(device.lost), std::to_string(device.late), fixed(device.clock_offset_ms, 3),
               fixed(device.clock_drift_ppm, 1), std::to_string(device.connections)});
    for (std::size_t i = 0; i < std::size(device.rejected); ++i) {
      if (device.rejected[i] > 0) {
        reasons += "  " + name + " rejected " + std::to_string(device.rejected[i]) + ": " +
                   std::string(reject_label(static_cast<wire::RejectReason>(i))) + "\n";
      }
    }
    if (device.malformed_bodies > 0) {
      reasons +=
          "  " + name + " sent " + std::to_string(device.malformed_bodies) + " malformed tools in other samples\n";
    }
    if (device.other_writer > 0 || device.takeovers > 0) {
      reasons += "  " + name + " has a second driver: " + std::to_string(device.other_writer) +
                 " of its samples were refused, it took over " + std::to_string(device.takeovers) + " times\n";
    }
  }
  if (health.unknown_device_samples > 0) {
    reasons += "  " + std::to_string(health.unknown_device_samples) + " samples of devices that are not configured\n";
  }
  return (table.empty() ? "Devices  none\n" : table.text()) + reasons;
}

std::string loops_text(const wire::SystemHealth &health) {
  Table table({"Loop", "Rate Hz", "Steps", "Overruns", "Step p50 us", "p99 us", "max us"});
  for (const auto &loop : loops(health)) {
    table.row({printable(wire::view(loop.loop)), loop.rate_hz > 0 ? fixed(loop.rate_hz, 1) : "by event",
               std::to_string(loop.steps), std::to_string(loop.overruns), fixed(loop.step_p50_us, 1),
               fixed(loop.step_p99_us, 1), fixed(loop.step_max_us, 1)});
  }
  return table.empty() ? "" : table.text();
}

json registration_json(const wire::RegistrationState &state) {
  return {{"status", registration_label(state.status)},
          {"reason", refusal_label(state.reason)},
          {"subject", wire::text(state.subject)},
          {"text", state.text},
          {"revision", state.revision},
          {"accepted_revision", state.accepted_revision},
          {"fiducials", state.fiducial_count},
          {"surface_points", state.surface_count},
          {"fiducial_consistency_fre_mm", json_number(state.fre_mm)},
          {"surface_rms_mm", json_number(state.surface_rms_mm)}};
}

json accuracy_json(const wire::AccuracyState &accuracy) {
  json out{{"targets", json::array()},
           {"check_count", accuracy.check_count},
           {"last_check_mm", json_number(accuracy.last_check_mm)},
           {"last_check_limit_mm", json_number(accuracy.last_check_limit_mm)},
           {"drift_statistic", json_number(accuracy.drift_statistic)},
           {"drift_threshold", json_number(accuracy.drift_threshold)},
           {"drift_detected", accuracy.drift_detected}};
  for (const auto &target : targets(accuracy)) {
    out["targets"].push_back({{"target", wire::text(target.target)},
                              {"tre_rms_mm", json_number(target.tre_rms_mm)},
                              {"tre_95_mm", json_number(target.tre_95.semi_axes_mm[0])},
                              {"image_rms_mm", json_number(target.image_rms_mm)}});
  }
  return out;
}

json device_json(const wire::DeviceHealth &device, const DaemonView &daemon) {
  json out = device_figures_json(device);
  out["device"] = wire::text(device.device);
  out["age_ms"] = json_number(age_ms(device, daemon));
  out["age_sigma_ms"] = json_number(device.age_sigma_ms);
  out["transit_ms"] = json_number(device.transit_ms);
  out["takeovers"] = device.takeovers;
  out["clock_offset_ms"] = json_number(device.clock_offset_ms);
  return out;
}

} // namespace

std::string status_text(const live::Snapshot &snapshot, std::uint32_t domain, const live::Now &now) {
  const DaemonView daemon = view_daemon(snapshot, now);
  std::string out = "bregmad on domain " + std::to_string(domain) + ": " + daemon.text;
  if (!snapshot.health) {
    return out + "\n";
  }
  const auto &health = *snapshot.health;
  out += ", " + case_text(health) + ", up " +
         duration_text(static_cast<double>(health.time_ns - health.started_time_ns) * 1e-9) + "\n";
  if (daemon.presence != Presence::kAlive) {
    out += "NOT CURRENT: these are the last values of a daemon that is silent.\n";
  }
  out += connection_text(snapshot) + wire_text(snapshot);
  out += "\n" + registration_text(snapshot);
  out += patient_not_tracked(snapshot) ? "  " + std::string(kNotTracked) + "\n" : "";
  out += accuracy_text(snapshot) + "\n";
  if (!snapshot.tools.empty()) {
    out += tools_table(snapshot, {}, now) + "\n";
  }
  out += devices_text(health, daemon) + "\n" + drivers_text(snapshot.drivers, now) + "\n" + loops_text(health) + "\n";
  out += recorder_text(health);
  out += "Memory  " + fixed(static_cast<double>(health.resident_bytes) / 1e6, 1, "MB") + " resident\n";
  for (const auto &[point, state] : snapshot.deformation) {
    out += "Deformation  " + prediction_line(view_prediction(state, daemon, now)) + "\n";
  }
  const auto alarms = standing_alarms(snapshot);
  out += alarms.empty() ? "Alarms  none\n" : "Alarms\n";
  for (const auto &alarm : alarms) {
    out += "  " + alarm_line(alarm, live::daemon_now_ns(snapshot, now.boot_ns)) + "\n";
  }
  return out;
}

json status_json(const live::Snapshot &snapshot, std::uint32_t domain, const live::Now &now) {
  const DaemonView daemon = view_daemon(snapshot, now);
  json out = watch_json(snapshot, {}, now);
  out["domain"] = domain;
  if (snapshot.registration) {
    out["registration"] = registration_json(*snapshot.registration);
  }
  if (snapshot.accuracy) {
    out["accuracy"] = accuracy_json(*snapshot.accuracy);
  }
  out["deformation"] = json::object();
  for (const auto &[point, state] : snapshot.deformation) {
    out["deformation"][point] = prediction_json(view_prediction(state, daemon, now));
  }
  if (!snapshot.health) {
    return out;
  }
  const auto &health = *snapshot.health;
  out["case_folder"] = health.case_folder;
  out["wire"] = wire::text_of({health.wire_generation, health.wire_revision});
  out["other_wire_participants"] = health.other_wire;
  out["mismatches"] = {{"daemon", health.mismatches}, {"own", snapshot.mismatches}};
  out["ill_typed_samples"] = health.ill_typed_samples;
  out["started_time_ns"] = health.started_time_ns;
  const bool clock_stated = health.wall_time_ns != 0;
  const double lead_ms = static_cast<double>(health.wall_time_ns - health.time_ns) * 1e-6;
  out["wall_clock"] = {{"lead_ms", json_number(clock_stated ? lead_ms : wire::kUnknown)},
                       {"error_ms", json_number(static_cast<double>(health.clock_error_ns) * 1e-6)},
                       {"steps", health.clock_steps},
                       {"last_step_ms", json_number(static_cast<double>(health.clock_step_ns) * 1e-6)}};
  out["unknown_device_samples"] = health.unknown_device_samples;
  out["resident_bytes"] = health.resident_bytes;
  out["recorder"] = recorder_json(health);
  out["devices"] = json::array();
  for (const auto &device : devices(health)) {
    out["devices"].push_back(device_json(device, daemon));
  }
  out["drivers"] = drivers_json(snapshot.drivers, now);
  out["loops"] = loops_json(health);
  return out;
}

} // namespace bregma::cli
