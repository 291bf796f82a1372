#include "clients/cli/report/summary.hpp"

#include <cmath>

#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"

namespace bregma::cli::report {
namespace {

using nlohmann::json;

std::string spread_text(const Distribution &values, int decimals, std::string_view unit) {
  if (values.count() == 0) {
    return "not known";
  }
  return "p50 " + fixed(values.percentile(0.5), decimals) + ", p99 " + fixed(values.percentile(0.99), decimals) +
         ", p99.9 " + fixed(values.percentile(0.999), decimals) + ", max " + fixed(values.max(), decimals) + " " +
         std::string(unit);
}

json spread_json(const Distribution &values) {
  return {{"count", values.count()},
          {"p50", json_number(values.percentile(0.5))},
          {"p99", json_number(values.percentile(0.99))},
          {"p999", json_number(values.percentile(0.999))},
          {"max", json_number(values.max())}};
}

std::string at_target_text(const AtTarget &target) {
  std::string out = "At the target  " + printable(target.tool) + " along " + printable(target.trajectory) + ", " +
                    std::to_string(target.samples) + " samples\n";
  out += "  shown distance to the target " + known(target.shown_distance_mm, 2, "mm") + " (median)\n";
  out += "  lateral deviation            " + known(target.lateral_mm, 2, "mm") + " (median)\n";
  out += "  true error of the shown tip  " + known(target.true_error_mm.percentile(0.5), 2, "mm") + " (median), " +
         known(target.true_error_mm.max(), 2, "mm") + " (worst)\n";
  out += "  predicted (TRE, RMS)         " + known(target.predicted_rms_mm, 2, "mm") + "\n";
  out += "  inside the predicted 95 %    " +
         (target.inside ? std::string(*target.inside ? "yes" : "NO") + " (" + fixed(100 * target.inside_share, 0) +
                              " % of the samples)"
                        : std::string("not known")) +
         "\n";
  out += "  of which the registration    " + known(target.registration_error_mm, 2, "mm") + " (true)\n";
  return out;
}

std::string devices_text(const SessionAnalysis &session) {
  Table table({"Device", "Kind", "Rate Hz", "Taken", "Lost", "Late", "Rejected", "Connects"});
  std::string reasons;
  for (const auto &device : session.devices) {
    std::uint64_t rejected = 0;
    for (const auto &[reason, count] : device.rejected) {
      rejected += count;
      reasons += "  " + printable(device.device) + " rejected " + std::to_string(count) + ": " + reason + "\n";
    }
    table.row({printable(device.device), device.kind, fixed(device.rate_hz, 1), std::to_string(device.taken),
               std::to_string(device.lost), std::to_string(device.late), std::to_string(rejected),
               std::to_string(device.connections)});
  }
  return table.empty() ? "Devices  none recorded\n" : table.text() + reasons;
}

std::string pivots_text(const SessionAnalysis &session) {
  std::string out;
  for (const PivotRecord &pivot : session.pivots) {
    out +=
        "Pivot of " + printable(pivot.tool) + "  " + (pivot.accepted ? "" : "refused: ") + printable(pivot.text) + "\n";
  }
  return out;
}

std::string image_part(const TargetPrediction &target) {
  return target.image_rms_mm > 0.0
             ? ", " + fixed(target.image_rms_mm, 2, "mm") + " of it from the registration of its image"
             : "";
}

std::string registration_text(const SessionAnalysis &session) {
  if (!session.registration) {
    return "Registration  none accepted\n";
  }
  const auto &registration = *session.registration;
  std::string out = "Registration  " + std::to_string(registration.fiducials) + " fiducials, " +
                    std::to_string(registration.surface_points) + " surface points\n";
  out += "  fiducials agree to " + known(registration.fre_mm, 2, "mm") + " (FRE: a consistency, not an accuracy)\n";
  for (const auto &target : registration.targets) {
    out += "  predicted error at " + printable(target.target) + "  " + known(target.tre_rms_mm, 2, "mm") +
           " RMS, 95 % within " + known(target.tre_95_mm, 2, "mm") + image_part(target) + "\n";
  }
  return out;
}

json registration_json(const RegistrationSummary &registration) {
  json out{{"revision", registration.revision},
           {"accepted_time_ns", registration.accepted_time_ns},
           {"fiducials", registration.fiducials},
           {"surface_points", registration.surface_points},
           {"fiducial_consistency_fre_mm", json_number(registration.fre_mm)},
           {"surface_rms_mm", json_number(registration.surface_rms_mm)},
           {"predicted_tre", json::array()},
           {"residuals", json::array()}};
  for (const auto &target : registration.targets) {
    out["predicted_tre"].push_back({{"target", target.target},
                                    {"rms_mm", json_number(target.tre_rms_mm)},
                                    {"bound_95_mm", json_number(target.tre_95_mm)},
                                    {"image_rms_mm", json_number(target.image_rms_mm)}});
  }
  for (const auto &one : registration.residuals) {
    out["residuals"].push_back({{"fiducial", one.fiducial},
                                {"residual_mm", json_number(one.residual_mm)},
                                {"leave_one_out_mm", json_number(one.leave_one_out_mm)},
                                {"p_value", json_number(one.p_value)},
                                {"suspect", one.suspect}});
  }
  return out;
}

std::string insertion_text(const InsertionAnalysis &insertion) {
  std::string out = "Tissue  " + printable(insertion.target) + " moves by up to " +
                    known(insertion.largest_motion_mm, 2, "mm") + " as predicted (" +
                    std::to_string(insertion.elements) + " tetrahedra; answers:";
  for (const auto &[status, count] : insertion.states) {
    out += " " + std::to_string(count) + " " + status;
  }
  out += ")\n";
  if (insertion.ruptures > 0) {
    out += "        " + std::to_string(insertion.ruptures) + " rupture" + (insertion.ruptures > 1 ? "s" : "") +
           ", the first at a modelled " + known(insertion.rupture_force_N, 3, "N") + " after an indentation of " +
           known(insertion.rupture_depth_mm, 1, "mm") + "\n";
  }
  for (const FollowedLandmark &landmark : insertion.landmarks) {
    out += "        landmark " + printable(landmark.landmark) + " moves by up to " +
           known(landmark.largest_motion_mm, 2, "mm") + "\n";
  }
  return out;
}

json insertion_json(const InsertionAnalysis &insertion) {
  json landmarks = json::array();
  for (const FollowedLandmark &landmark : insertion.landmarks) {
    landmarks.push_back({{"landmark", landmark.landmark},
                         {"largest_motion_mm", json_number(landmark.largest_motion_mm)},
                         {"error_bound_mm", json_number(landmark.error_bound_mm)}});
  }
  return {{"target", insertion.target},
          {"elements", insertion.elements},
          {"ruptures", insertion.ruptures},
          {"rupture_force_N", json_number(insertion.rupture_force_N)},
          {"rupture_depth_mm", json_number(insertion.rupture_depth_mm)},
          {"largest_motion_mm", json_number(insertion.largest_motion_mm)},
          {"stiffness_scale", json_number(insertion.stiffness_scale)},
          {"answers", insertion.states},
          {"reasons", insertion.reasons},
          {"landmarks", std::move(landmarks)}};
}

json at_target_json(const AtTarget &target) {
  return {{"tool", target.tool},
          {"trajectory", target.trajectory},
          {"samples", target.samples},
          {"shown_distance_mm", json_number(target.shown_distance_mm)},
          {"lateral_deviation_mm", json_number(target.lateral_mm)},
          {"true_error_mm", spread_json(target.true_error_mm)},
          {"predicted_tre_rms_mm", json_number(target.predicted_rms_mm)},
          {"inside_95", target.inside ? json(*target.inside) : json()},
          {"inside_95_share", json_number(target.inside_share)},
          {"registration_error_mm", json_number(target.registration_error_mm)}};
}

json path_json(const PathSummary &path, const SessionAnalysis &session) {
  return {{"trajectory", path.trajectory},
          {"max_lateral_deviation_mm", json_number(path.largest_lateral_mm)},
          {"time_s", session.seconds(path.time_ns)},
          {"remaining_depth_mm", json_number(path.remaining_depth_mm)}};
}

json judgement_json(const Judgement &one) {
  return {{"name", one.name},   {"text", one.text},       {"value", json_number(one.value)},
          {"limit", one.limit}, {"at_most", one.at_most}, {"unit", one.unit},
          {"holds", one.holds}};
}

} // namespace

std::string value_text(const Judgement &judgement) {
  if (!std::isfinite(judgement.value)) {
    return "not known";
  }
  if (judgement.name.starts_with("require_")) {
    return judgement.value > 0.5 ? "yes" : "no";
  }
  return judgement.unit.empty() ? fixed(judgement.value, 0) : fixed(judgement.value, 3, judgement.unit);
}

std::string limit_text(const Judgement &judgement) {
  if (judgement.name.starts_with("require_")) {
    return "required";
  }
  char figure[32];
  std::snprintf(figure, sizeof(figure), "%g", judgement.limit);
  return std::string(judgement.at_most ? "at most " : "at least ") + figure +
         (judgement.unit.empty() ? "" : " " + judgement.unit);
}

std::string summary_text(const SessionAnalysis &session, const std::vector<Judgement> &judgements) {
  std::string out = "Session of " + duration_text(session.seconds(session.end_ns)) + ", " +
                    std::to_string(session.records) + " records, " + std::to_string(session.tracker_frames) +
                    " tracker frames" + (session.has_truth ? "" : "; no truth recorded, so true errors are not known") +
                    "\n\n";
  out += "Navigation  " + known(session.navigation_rate_hz, 1, "states/s while navigating") + "\n";
  out += "Latency  exposure to published   " + spread_text(session.exposure_to_published_ms, 3, "ms") + "\n";
  out += "         frame sent to published " + spread_text(session.sent_to_published_ms, 3, "ms") + "\n\n";
  out += devices_text(session) + "\n" + pivots_text(session) + registration_text(session);
  out += session.at_target ? at_target_text(*session.at_target) : "At the target  the tip was never held there\n";
  if (session.approaches.empty()) {
    out += session.structures == 0 ? "Critical structures  this case has none\n"
                                   : "Critical structures  none approached\n";
  }
  if (session.path_summary) {
    out += "Path along " + printable(session.path_summary->trajectory) + "  largest lateral deviation " +
           known(session.path_summary->largest_lateral_mm, 2, "mm") + ", " +
           known(session.path_summary->remaining_depth_mm, 1, "mm") + " before the target\n";
  }
  for (const auto &approach : session.approaches) {
    out += "Closest to " + printable(approach.structure) + "  " + known(approach.shown_mm, 1, "mm") + " shown, " +
           (std::isfinite(approach.true_at_least_mm) ? "truly at least " + fixed(approach.true_at_least_mm, 1, "mm")
                                                     : std::string("true distance not known")) +
           ", at " + duration_text(session.seconds(approach.time_ns)) + "\n";
  }
  out += session.insertion ? insertion_text(*session.insertion) : "Tissue  no model followed a probe into the brain\n";
  for (const auto &check : session.checks) {
    out += "Check of " + printable(check.landmark) + "  " + known(check.distance_mm, 2, "mm") + " (95 % bound " +
           known(check.limit_mm, 2, "mm") + ")\n";
  }
  out += "Alarms  " + std::to_string(session.alarms.size()) + " changes, " + std::to_string(session.critical_alarms) +
         " critical raised, " + std::to_string(session.unacknowledged_critical) + " of them never acknowledged\n";
  out += "States ";
  for (const auto &span : session.states) {
    out += (&span == session.states.data() ? " " : " > ") + span.state;
  }
  out += session.states.empty() ? " not recorded\n" : "\n";
  if (session.record_dropped > 0) {
    out +=
        "Recorder  " + std::to_string(session.record_dropped) + " records were dropped: the figures are incomplete\n";
  }
  if (!judgements.empty()) {
    Table table({"Limit", "What", "Value", "Wanted", "Holds"});
    for (const auto &one : judgements) {
      table.row({one.name, one.text, value_text(one), limit_text(one), one.holds ? "yes" : "NO"});
    }
    out += "\n" + table.text() + (all_hold(judgements) ? "\nAll limits were kept.\n" : "\nLimits were exceeded.\n");
  }
  return out;
}

json summary_json(const SessionAnalysis &session, const std::vector<Judgement> &judgements) {
  json out{{"start_time_ns", session.start_ns},
           {"duration_s", session.seconds(session.end_ns)},
           {"records", session.records},
           {"tracker_frames", session.tracker_frames},
           {"record_dropped", session.record_dropped},
           {"has_truth", session.has_truth},
           {"seed", session.seed ? json(*session.seed) : json(nullptr)},
           {"path", session.path_summary ? path_json(*session.path_summary, session) : json()},
           {"navigation_rate_hz", json_number(session.navigation_rate_hz)},
           {"latency_exposure_to_published_ms", spread_json(session.exposure_to_published_ms)},
           {"latency_sent_to_published_ms", spread_json(session.sent_to_published_ms)},
           {"verified_before_navigation", session.verified_before_navigation},
           {"registration", session.registration ? registration_json(*session.registration) : json()},
           {"at_target", session.at_target ? at_target_json(*session.at_target) : json()},
           {"insertion", session.insertion ? insertion_json(*session.insertion) : json()},
           {"rejected", session.rejected_in_all()},
           {"unknown_device_samples", session.unknown_device_samples},
           {"critical_alarms", session.critical_alarms},
           {"unacknowledged_critical_alarms", session.unacknowledged_critical}};
  for (const auto *list :
       {"pivots", "meta", "devices", "loops", "approaches", "checks", "alarms", "states", "limits"}) {
    out[list] = json::array();
  }
  for (const auto &entry : session.meta) {
    out["meta"].push_back({{"key", entry.key}, {"value", entry.value}});
  }
  for (const PivotRecord &pivot : session.pivots) {
    out["pivots"].push_back({{"tool", pivot.tool},
                             {"time_s", session.seconds(pivot.time_ns)},
                             {"accepted", pivot.accepted},
                             {"rms_mm", json_number(pivot.rms_mm)},
                             {"text", pivot.text}});
  }
  for (const auto &device : session.devices) {
    out["devices"].push_back({{"device", device.device},
                              {"kind", device.kind},
                              {"rate_hz", json_number(device.rate_hz)},
                              {"taken", device.taken},
                              {"lost", device.lost},
                              {"late", device.late},
                              {"connections", device.connections},
                              {"rejected_by_reason", device.rejected}});
  }
  for (const auto &loop : session.loops) {
    out["loops"].push_back({{"loop", loop.loop},
                            {"rate_hz", json_number(loop.rate_hz)},
                            {"steps", loop.steps},
                            {"overruns", loop.overruns},
                            {"step_p50_us", json_number(loop.step_p50_us)},
                            {"step_p99_us", json_number(loop.step_p99_us)},
                            {"step_max_us", json_number(loop.step_max_us)}});
  }
  for (const auto &approach : session.approaches) {
    out["approaches"].push_back({{"structure", approach.structure},
                                 {"tool", approach.tool},
                                 {"time_s", session.seconds(approach.time_ns)},
                                 {"shown_mm", json_number(approach.shown_mm)},
                                 {"true_at_least_mm", json_number(approach.true_at_least_mm)}});
  }
  for (const auto &check : session.checks) {
    out["checks"].push_back({{"time_s", session.seconds(check.time_ns)},
                             {"tool", check.tool},
                             {"landmark", check.landmark},
                             {"distance_mm", json_number(check.distance_mm)},
                             {"limit_95_mm", json_number(check.limit_mm)}});
  }
  for (const auto &alarm : session.alarms) {
    out["alarms"].push_back({{"time_s", session.seconds(alarm.time_ns)},
                             {"kind", alarm.kind},
                             {"subject", alarm.subject},
                             {"state", alarm.state},
                             {"severity", alarm.severity},
                             {"text", alarm.text}});
  }
  for (const auto &span : session.states) {
    out["states"].push_back(
        {{"from_s", session.seconds(span.from_ns)}, {"to_s", session.seconds(span.to_ns)}, {"state", span.state}});
  }
  for (const auto &one : judgements) {
    out["limits"].push_back(judgement_json(one));
  }
  if (!judgements.empty()) {
    out["all_limits_hold"] = all_hold(judgements);
  }
  return out;
}

} // namespace bregma::cli::report
