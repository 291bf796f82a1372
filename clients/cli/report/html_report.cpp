#include "clients/cli/report/html_report.hpp"

#include <cmath>
#include <ctime>

#include "base/plots.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/report/figures.hpp"
#include "clients/cli/report/page_parts.hpp"
#include "clients/cli/report/summary.hpp"

namespace bregma::cli::report {
namespace {

std::string date_text(std::int64_t time_ns) {
  const std::time_t seconds = static_cast<std::time_t>(time_ns / 1'000'000'000);
  std::tm parts{};
  char text[64];
  return gmtime_r(&seconds, &parts) != nullptr && std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M:%S UTC", &parts) > 0
             ? text
             : "date not known";
}

std::string meta_of(const SessionAnalysis &session, std::string_view key) {
  for (const auto &entry : session.meta) {
    if (entry.key == key) {
      return entry.value;
    }
  }
  return {};
}

std::string case_of(const SessionAnalysis &session) {
  const std::string name = meta_of(session, "case");
  return name.empty() ? "session" : name;
}

std::string version_of(const SessionAnalysis &session) {
  const std::string version = meta_of(session, "version");
  const std::string build = meta_of(session, "build");
  return version.empty() ? "version not known" : "bregmad " + version + (build.empty() ? "" : " (" + build + ")");
}

std::string page_header(const SessionAnalysis &session, const std::vector<Judgement> &judgements) {
  std::size_t broken = 0;
  for (const auto &one : judgements) {
    broken += one.holds ? 0 : 1;
  }
  const std::string badge =
      judgements.empty() ? "<span class='badge'>no limits given</span>"
      : broken == 0      ? "<span class='badge good'>all " + std::to_string(judgements.size()) + " limits kept</span>"
                    : "<span class='badge bad'>" + std::to_string(broken) + " of " + std::to_string(judgements.size()) +
                          " limits exceeded</span>";
  std::string sub = date_text(session.start_ns) + " \u00b7 " + duration_text(session.seconds(session.end_ns)) +
                    " \u00b7 " + std::to_string(session.tracker_frames) + " tracker frames";
  if (session.has_truth) {
    sub += " \u00b7 simulated" + (session.seed ? " with seed " + std::to_string(*session.seed) : std::string()) +
           ", so the truth is known";
  } else {
    sub += " \u00b7 true errors are not known";
  }
  sub += " \u00b7 " + version_of(session);
  return "<header><h1>Navigation report: " + base::escape(case_of(session)) + "</h1>" + badge + "<p class='sub'>" +
         base::escape(sub) + "</p></header>";
}

std::string key_figures(const SessionAnalysis &session) {
  std::string out = "<div class='cards'>";
  const AtTarget none;
  const AtTarget &target = session.at_target ? *session.at_target : none;
  out += card("True error at the target", known(target.true_error_mm.percentile(0.5), 2, "mm"),
              session.at_target ? "of the shown tip, median; worst " + known(target.true_error_mm.max(), 2, "mm")
                                : std::string("no tip was held at the target"));
  out += card("Predicted error at the target", known(target.predicted_rms_mm, 2, "mm"),
              target.inside ? (*target.inside ? "TRE, RMS; the true error lay inside the predicted 95 % region"
                                              : "TRE, RMS; the true error lay OUTSIDE the predicted 95 % region")
                            : "TRE, RMS of the shown tip");
  const auto *nearest = session.approaches.empty() ? nullptr : &session.approaches.front();
  out += card("Closest critical structure", nearest != nullptr ? known(nearest->shown_mm, 1, "mm") : "none",
              nearest == nullptr
                  ? (session.structures == 0 ? "this case has no structures" : "none was approached while navigating")
              : std::isfinite(nearest->true_at_least_mm)
                  ? nearest->structure + "; truly at least " + fixed(nearest->true_at_least_mm, 1, "mm")
                  : nearest->structure + "; the true distance is not known");
  out += card("Latency, median", known(session.sent_to_published_ms.percentile(0.5), 2, "ms"),
              "frame sent to state published; 99 % " + known(session.sent_to_published_ms.percentile(0.99), 2, "ms") +
                  ", 99.9 % " + known(session.sent_to_published_ms.percentile(0.999), 2, "ms"));
  std::uint64_t lost = 0;
  std::uint64_t late = 0;
  for (const auto &device : session.devices) {
    lost += device.lost;
    late += device.late;
  }
  out += card("Lost samples", session.devices.empty() ? "not known" : std::to_string(lost),
              std::to_string(late) + " late, " + std::to_string(session.rejected_in_all()) + " rejected, all devices");
  out += card("Navigation rate", known(session.navigation_rate_hz, 0, "Hz"), "states per second while navigating");
  out +=
      card("Consistency of the fiducials", session.registration ? known(session.registration->fre_mm, 2, "mm") : "none",
           "FRE: consistency of the fiducials. It is not an accuracy.");
  return out + "</div>";
}

std::string limits_table(const std::vector<Judgement> &judgements) {
  HtmlTable table({"What", "#Value", "#Wanted", "Holds"});
  for (const auto &one : judgements) {
    table.row({one.text, value_text(one), limit_text(one), one.holds ? "yes" : "no"}, one.holds ? "yes" : "no");
  }
  return table.any() ? table.text() : std::string();
}

std::string registration_tables(const SessionAnalysis &session) {
  if (!session.registration) {
    return "<p>No registration was accepted.</p>";
  }
  const auto &registration = *session.registration;
  std::string out = "<p>" + std::to_string(registration.fiducials) + " fiducials and " +
                    std::to_string(registration.surface_points) + " surface points, accepted at " +
                    base::escape(duration_text(session.seconds(registration.accepted_time_ns))) + ".</p>";
  if (registration.T_image_reference.allFinite()) {
    HtmlTable matrix({"#", "#", "#", "#"});
    for (Eigen::Index i = 0; i < 4; ++i) {
      std::vector<std::string> cells;
      for (Eigen::Index j = 0; j < 4; ++j) {
        cells.push_back(fixed(registration.T_image_reference(i, j), j < 3 ? 6 : 3));
      }
      matrix.row(cells);
    }
    out += "<h3>From Reference to Image (RAS, mm)</h3>" + matrix.text();
  }
  HtmlTable targets({"Target", "#Predicted TRE, RMS mm", "#95 % within mm", "#Of it from image mm"});
  for (const auto &target : registration.targets) {
    targets.row({target.target, fixed(target.tre_rms_mm, 2), fixed(target.tre_95_mm, 2),
                 target.image_rms_mm > 0.0 ? fixed(target.image_rms_mm, 2) : std::string("–")});
  }
  out += targets.any() ? targets.text() : std::string();
  HtmlTable fiducials({"Fiducial", "#Residual mm", "#Left out mm", "#p", "Suspect"});
  for (const auto &one : registration.residuals) {
    fiducials.row({one.fiducial, fixed(one.residual_mm, 2), fixed(one.leave_one_out_mm, 2), fixed(one.p_value, 3),
                   one.suspect ? "yes" : "no"},
                  one.suspect ? "no" : "");
  }
  if (fiducials.any()) {
    out += "<h3>Residuals of the fiducials</h3>" + fiducials.text() +
           "<p class='note'>\u201cLeft out\u201d is the distance when the fit does not use the fiducial. Residuals "
           "measure the agreement of the fiducials, not the error at the target.</p>";
  }
  return out;
}

std::string checks_table(const SessionAnalysis &session) {
  HtmlTable table({"Landmark", "Tool", "#At s", "#Distance mm", "#95 % bound mm"});
  for (const auto &check : session.checks) {
    const bool beyond = check.distance_mm > check.limit_mm;
    table.row({check.landmark, check.tool, fixed(session.seconds(check.time_ns), 1), fixed(check.distance_mm, 2),
               fixed(check.limit_mm, 2)},
              beyond ? "no" : "");
  }
  return table.any() ? table.text() : std::string();
}

std::string insertion_table(const InsertionAnalysis &insertion) {
  HtmlTable table({"Target", "#Tetrahedra", "#Ruptures", "#At a modelled force of N", "#At an indentation of mm",
                   "#Largest motion mm", "#Measured : modelled stiffness"});
  table.row({insertion.target, std::to_string(insertion.elements), std::to_string(insertion.ruptures),
             fixed(insertion.rupture_force_N, 3), fixed(insertion.rupture_depth_mm, 1),
             fixed(insertion.largest_motion_mm, 2), fixed(insertion.stiffness_scale, 2)});
  HtmlTable answers({"Answers of the model", "#Number"});
  for (const auto &[name, count] : insertion.states) {
    answers.row({name, std::to_string(count)});
  }
  HtmlTable reasons({"Why an answer was not valid", "#Number"});
  for (const auto &[name, count] : insertion.reasons) {
    reasons.row({name, std::to_string(count)});
  }
  HtmlTable landmarks({"Landmark in the brain", "#Largest motion mm", "#Its error bound mm"});
  for (const FollowedLandmark &landmark : insertion.landmarks) {
    landmarks.row({landmark.landmark, fixed(landmark.largest_motion_mm, 2), fixed(landmark.error_bound_mm, 2)});
  }
  return table.text() + (landmarks.any() ? landmarks.text() : std::string()) +
         (answers.any() ? answers.text() : std::string()) + (reasons.any() ? reasons.text() : std::string());
}

std::string approaches_table(const SessionAnalysis &session) {
  HtmlTable table({"Structure", "Tool", "#At s", "#Shown mm", "#Truly at least mm"});
  for (const auto &approach : session.approaches) {
    table.row({approach.structure, approach.tool, fixed(session.seconds(approach.time_ns), 1),
               fixed(approach.shown_mm, 1), fixed(approach.true_at_least_mm, 1)});
  }
  return table.any() ? table.text() : std::string();
}

std::string devices_tables(const SessionAnalysis &session) {
  HtmlTable devices({"Device", "Kind", "#Rate Hz", "#Taken", "#Lost", "#Late", "#Connects", "Rejected"});
  for (const auto &device : session.devices) {
    std::string reasons;
    for (const auto &[reason, count] : device.rejected) {
      reasons += (reasons.empty() ? "" : ", ") + std::to_string(count) + " " + reason;
    }
    devices.row({device.device, device.kind, fixed(device.rate_hz, 1), std::to_string(device.taken),
                 std::to_string(device.lost), std::to_string(device.late), std::to_string(device.connections),
                 reasons.empty() ? "none" : reasons});
  }
  HtmlTable loops({"Loop", "#Rate Hz", "#Steps", "#Overruns", "#Step p50 \u00b5s", "#p99 \u00b5s", "#max \u00b5s"});
  for (const auto &loop : session.loops) {
    loops.row({loop.loop, loop.rate_hz > 0 ? fixed(loop.rate_hz, 0) : "by event", std::to_string(loop.steps),
               std::to_string(loop.overruns), fixed(loop.step_p50_us, 1), fixed(loop.step_p99_us, 1),
               fixed(loop.step_max_us, 1)});
  }
  std::string out = devices.any() ? devices.text() : std::string();
  if (session.unknown_device_samples > 0) {
    out += "<p class='note'>" + std::to_string(session.unknown_device_samples) +
           " samples came from devices that are not configured.</p>";
  }
  return out + (loops.any() ? "<h3>Loops of the daemon</h3>" + loops.text() : std::string());
}

std::string alarms_table(const SessionAnalysis &session) {
  HtmlTable table({"#At s", "Alarm", "Subject", "State", "Severity", "Text"});
  for (const auto &alarm : session.alarms) {
    table.row(
        {fixed(session.seconds(alarm.time_ns), 1), alarm.kind, alarm.subject, alarm.state, alarm.severity, alarm.text});
  }
  return table.any() ? table.text() : std::string("<p>No alarm was raised.</p>");
}

std::string meta_table(const SessionAnalysis &session) {
  HtmlTable table({"Recorded", "Value"});
  for (const auto &entry : session.meta) {
    table.row({entry.key, entry.value});
  }
  return table.any() ? table.text() : std::string();
}

std::string path_table(const SessionAnalysis &session) {
  if (session.path.empty()) {
    return {};
  }
  HtmlTable table(
      {"Trajectory", "#Largest lateral deviation mm", "#At s", "#Before the target mm", "#At the target, median mm"});
  const double at_target_mm = session.at_target ? session.at_target->lateral_mm : geometry::kUnknown;
  const PathSummary none;
  const PathSummary &path = session.path_summary ? *session.path_summary : none;
  table.row({session.path_summary ? path.trajectory : session.path.front().trajectory,
             fixed(path.largest_lateral_mm, 2),
             session.path_summary ? fixed(session.seconds(path.time_ns), 1) : std::string("-"),
             fixed(path.remaining_depth_mm, 1), fixed(at_target_mm, 2)});
  return table.text() + (session.path_summary
                             ? "<p class='note'>Between entry and target, of the shown tip.</p>"
                             : "<p class='note'>The session file holds no plan, or the tip was never between entry and "
                               "target.</p>");
}

std::string pivots_table(const SessionAnalysis &session) {
  HtmlTable table({"Tool", "#At s", "#Residual RMS mm", "Result", "Calibrated"});
  for (const PivotRecord &pivot : session.pivots) {
    table.row({pivot.tool, fixed(session.seconds(pivot.time_ns), 1), fixed(pivot.rms_mm, 2), pivot.text,
               pivot.accepted ? "yes" : "no"},
              pivot.accepted ? "yes" : "no");
  }
  return table.any() ? table.text() : std::string("<p>No tool was calibrated in this session.</p>");
}

} // namespace

base::Result<std::string> html_report(const SessionAnalysis &session, const std::vector<Judgement> &judgements) {
  const auto heads = head_figure(session);
  if (!heads) {
    return tl::unexpected(heads.error());
  }
  const auto path_on_head = path_on_head_figure(session);
  if (!path_on_head) {
    return tl::unexpected(path_on_head.error());
  }
  std::string out = page_header(session, judgements) + key_figures(session);
  if (session.record_dropped > 0) {
    out += section("The recording is incomplete", "<p>" + std::to_string(session.record_dropped) +
                                                      " records were dropped; the figures are incomplete.</p>");
  }
  out += section("Limits of the scenario", limits_table(judgements));
  out += section("The session", timeline_figure(session));
  out += section("Error of the shown tip", error_figure(session));
  out += columns(section("Predicted against true error", calibration_figure(session)),
                 section("Latency", latency_figure(session)));
  out += section("The path along the plan",
                 path_table(session) + pair(path_figure(session), deviation_figure(session)) + *path_on_head);
  if (session.insertion) {
    out += section("The brain under the probe",
                   insertion_table(*session.insertion) + tissue_motion_figure(session) + tissue_still_figure(session));
    out += columns(section("Force", tissue_force_figure(session)), section("Stress", tissue_stress_figure(session)));
  }
  const bool traced = session.registration && session.registration->surface_points > 0;
  const std::string missing =
      heads->empty() && traced
          ? "<p class='note'>The session file holds no scalp, or no traced points: nothing is drawn.</p>"
          : std::string();
  out += section("Scalp residuals on the head", *heads + residual_figure(session) + missing);
  out += section("Calibration of the tools", pivots_table(session));
  out += columns(section("Registration", registration_tables(session)),
                 section("Checks and clearances",
                         (session.checks.empty() ? std::string() : "<h3>Check touches</h3>" + checks_table(session)) +
                             (session.approaches.empty()
                                  ? std::string()
                                  : "<h3>Closest approach while navigating</h3>" + approaches_table(session))));
  out += section("Devices", devices_tables(session));
  out += section("Alarms", alarms_table(session), "long");
  out += section("About this recording", meta_table(session), "long");
  out += "<footer>Lengths in millimetres, image coordinates RAS. Accuracy is the predicted target error (TRE) "
         "with its 95 % region; the consistency of fiducials (FRE) is never an accuracy.</footer>";
  return page("Navigation report: " + case_of(session), out);
}

} // namespace bregma::cli::report
