#include <algorithm>
#include <array>
#include <cmath>

#include "algorithms/geometry/unknown.hpp"
#include "clients/cli/report/figure_layout.hpp"
#include "clients/cli/report/figures.hpp"

namespace bregma::cli::report {
namespace {

using Value = double (*)(const TissueSample &);

double all_force_N(const TissueSample &sample) { return sample.tip_force_N + sample.shaft_force_N; }

// Curve over depth, interrupted where the model's answer is invalid, the phase changes or the probe stands still.
base::Series course(const InsertionAnalysis &insertion, const char *name, const char *paint, Value value,
                    bool backwards) {
  base::Series out;
  out.name = name;
  out.colour = paint;
  out.dashed = backwards;
  for (const TissueSample &sample : insertion.samples) {
    const bool shown = (sample.phase == "withdrawal") == backwards && sample.status != "invalid" && !sample.still;
    out.points.push_back({sample.depth_mm, shown ? value(sample) : geometry::kUnknown});
  }
  return out;
}

base::Plot plot_of(const InsertionAnalysis &insertion, const char *title, const char *unit_label) {
  base::Plot plot;
  plot.title = title;
  plot.x.label = "depth in the tissue, mm";
  plot.x.from = 0.0;
  plot.y.label = unit_label;
  if (std::isfinite(insertion.rupture_depth_mm)) {
    plot.rules.push_back({base::RuleKind::kVertical, insertion.rupture_depth_mm, "rupture", "#374151"});
  }
  return plot;
}

// Predicted motion of the target, from zero, during insertion and withdrawal.
base::Plot in_and_out(const InsertionAnalysis &insertion, const char *title, const char *unit_label, Value value) {
  base::Plot plot = plot_of(insertion, title, unit_label);
  plot.y.from = 0.0;
  plot.series.push_back(course(insertion, "pushed in", base::colour::kBlue, value, false));
  plot.series.push_back(course(insertion, "drawn back", base::colour::kBlue, value, true));
  return plot;
}

// Curve over time where the probe stands still.
base::Series standing(const SessionAnalysis &session, const char *name, const char *paint, Value value) {
  base::Series out;
  out.name = name;
  out.colour = paint;
  for (const TissueSample &sample : session.insertion->samples) {
    const bool shown = sample.still && sample.status != "invalid";
    out.points.push_back({session.seconds(sample.time_ns), shown ? value(sample) : geometry::kUnknown});
  }
  return out;
}

} // namespace

std::string tissue_still_figure(const SessionAnalysis &session) {
  const bool stood =
      session.insertion && std::any_of(session.insertion->samples.begin(), session.insertion->samples.end(),
                                       [](const TissueSample &sample) { return sample.still; });
  if (!stood) {
    return {};
  }
  base::Plot motion;
  motion.title = "Motion of the target over time, where the probe stands still";
  motion.x.label = "time, s";
  motion.y.label = "predicted motion of the target, mm";
  motion.y.from = 0.0;
  motion.series.push_back(
      standing(session, "", base::colour::kBlue, [](const TissueSample &sample) { return sample.motion_mm; }));
  base::Plot force;
  force.title = "Force over time, where the probe stands still";
  force.x.label = "time, s";
  force.y.label = "force along the shaft, N";
  base::Series measured = standing(session, "measured", base::colour::kGrey,
                                   [](const TissueSample &sample) { return sample.measured_force_N; });
  measured.mark = base::Mark::kPoints;
  measured.size = 1.2;
  force.series.push_back(std::move(measured));
  force.series.push_back(standing(session, "model: tip and shaft", base::colour::kBlue, all_force_N));
  return "<div class='pair'>" +
         half_width(motion, "The target relaxes while the probe stands still (its depth changes by less than half a "
                            "millimetre for a second or more).") +
         half_width(force, "Force of the probe on the tissue at the same time.") + "</div>";
}

std::string tissue_force_figure(const SessionAnalysis &session) {
  if (!session.insertion) {
    return {};
  }
  const InsertionAnalysis &insertion = *session.insertion;
  base::Plot plot = plot_of(insertion, "Force against depth", "force along the shaft, N");
  base::Series measured = course(
      insertion, "measured", base::colour::kGrey, [](const TissueSample &s) { return s.measured_force_N; }, false);
  measured.mark = base::Mark::kPoints;
  measured.size = 1.2;
  plot.series.push_back(std::move(measured));
  plot.series.push_back(course(insertion, "model: tip and shaft", base::colour::kBlue, all_force_N, false));
  plot.series.push_back(course(
      insertion, "model: tip", base::colour::kOrange, [](const TissueSample &s) { return s.tip_force_N; }, false));
  plot.series.push_back(course(insertion, "model: drawn back", base::colour::kBlue, all_force_N, true));
  return half_width(plot, "Force of the probe on the tissue, by the model and by the sensor in its grip. "
                          "Before the rupture the depth is that of the indentation. Where the probe stands still, the "
                          "course over time is shown instead.");
}

std::string tissue_stress_figure(const SessionAnalysis &session) {
  return session.insertion
             ? half_width(in_and_out(*session.insertion, "Stress at the target against depth", "von Mises stress, Pa",
                                     [](const TissueSample &s) { return s.von_mises_Pa; }),
                          "Von Mises stress in the tissue at the target as the probe approaches it.")
             : std::string();
}

std::string tissue_motion_figure(const SessionAnalysis &session) {
  if (!session.insertion) {
    return {};
  }
  base::Plot plot = in_and_out(*session.insertion, "Motion of the target against depth",
                               "predicted motion of the target, mm", [](const TissueSample &s) { return s.motion_mm; });
  plot.series.push_back(course(
      *session.insertion, "its error bound", base::colour::kGrey,
      [](const TissueSample &s) { return s.error_bound_mm; }, false));
  return full_width(plot,
                    "Predicted displacement of the target from its imaged position, and validity of the prediction. "
                    "Answers that extrapolate are drawn too, and counted above; invalid ones are not.");
}

} // namespace bregma::cli::report
