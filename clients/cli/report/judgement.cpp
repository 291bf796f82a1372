#include "clients/cli/report/judgement.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "algorithms/geometry/unknown.hpp"

namespace bregma::cli::report {
namespace {

double worst_target_tre_mm(const RegistrationSummary &registration) {
  double worst = geometry::kUnknown;
  for (const auto &target : registration.targets) {
    if (!std::isfinite(target.tre_rms_mm)) {
      return geometry::kUnknown; // an unknown error may be the largest one
    }
    worst = std::isfinite(worst) ? std::max(worst, target.tre_rms_mm) : target.tre_rms_mm;
  }
  return worst;
}

double worst_check_mm(const std::vector<CheckRecord> &checks) {
  double worst = geometry::kUnknown;
  for (const auto &check : checks) {
    worst = std::isfinite(worst) ? std::max(worst, check.distance_mm) : check.distance_mm;
  }
  return worst;
}

// Known only if the clearance of every approached structure is known.
double smallest_clearance_mm(const std::vector<Approach> &approaches) {
  double least = geometry::kUnknown;
  for (const auto &approach : approaches) {
    if (!std::isfinite(approach.true_at_least_mm)) {
      return geometry::kUnknown;
    }
    least = std::isfinite(least) ? std::min(least, approach.true_at_least_mm) : approach.true_at_least_mm;
  }
  return least;
}

double lost_percent(const std::vector<DeviceSummary> &devices) {
  std::uint64_t lost = 0;
  std::uint64_t taken = 0;
  for (const auto &device : devices) {
    if (device.kind == "tracker") {
      lost += device.lost;
      taken += device.taken;
    }
  }
  return lost + taken > 0 ? 100.0 * static_cast<double>(lost) / static_cast<double>(lost + taken) : geometry::kUnknown;
}

class Judge {
public:
  void at_most(const char *name, const char *text, double value, std::optional<double> limit, const char *unit) {
    if (limit) {
      out.push_back({name, text, value, *limit, unit, true, std::isfinite(value) && value <= *limit});
    }
  }
  void at_least(const char *name, const char *text, double value, std::optional<double> limit, const char *unit) {
    if (limit) {
      out.push_back({name, text, value, *limit, unit, false, std::isfinite(value) && value >= *limit});
    }
  }
  std::vector<Judgement> out;
};

std::optional<double> real(std::optional<std::int64_t> count) {
  return count ? std::optional(static_cast<double>(*count)) : std::nullopt;
}

double yes_or_no(std::optional<bool> value) { return value ? (*value ? 1.0 : 0.0) : geometry::kUnknown; }

} // namespace

std::vector<Judgement> judge(const SessionAnalysis &session, const casefile::RunLimits &limits) {
  const auto &registration = session.registration;
  const auto &target = session.at_target;
  const auto of_registration = [&](auto value) { return registration ? value(*registration) : geometry::kUnknown; };
  Judge judge;
  judge.at_most("max_tip_error_at_target_mm", "true error of the shown tip held at the target, median",
                target ? target->true_error_mm.percentile(0.5) : geometry::kUnknown, limits.max_tip_error_at_target_mm,
                "mm");
  judge.at_most("max_fre_mm", "consistency of the fiducials (FRE; not an accuracy)",
                of_registration([](const auto &r) { return r.fre_mm; }), limits.max_fre_mm, "mm");
  judge.at_most("max_predicted_tre_mm", "predicted target error (TRE), RMS, worst target",
                of_registration(worst_target_tre_mm), limits.max_predicted_tre_mm, "mm");
  judge.at_most("max_check_mm", "largest check touch", worst_check_mm(session.checks), limits.max_check_mm, "mm");
  judge.at_least("min_navigation_rate_hz", "navigation states per second while navigating", session.navigation_rate_hz,
                 limits.min_navigation_rate_hz, "Hz");
  judge.at_most("max_latency_p99_ms", "tracker's write to published state, 99 %",
                session.sent_to_published_ms.percentile(0.99), limits.max_latency_p99_ms, "ms");
  judge.at_most("max_lost_samples_percent", "lost tracker frames", lost_percent(session.devices),
                limits.max_lost_samples_percent, "%");
  judge.at_least("min_clearance_mm", "true tip to the nearest critical structure, at least",
                 smallest_clearance_mm(session.approaches), limits.min_clearance_mm, "mm");
  judge.at_most("max_rejected", "rejected samples, all devices and reasons",
                session.devices.empty() ? geometry::kUnknown : static_cast<double>(session.rejected_in_all()),
                real(limits.max_rejected), "");
  judge.at_least("min_fiducials", "fiducials of the accepted registration",
                 of_registration([](const auto &r) { return static_cast<double>(r.fiducials); }),
                 real(limits.min_fiducials), "");
  judge.at_least("min_surface_samples", "surface points of the accepted registration",
                 of_registration([](const auto &r) { return static_cast<double>(r.surface_points); }),
                 real(limits.min_surface_samples), "");
  judge.at_most("max_unacknowledged_critical_alarms", "critical alarms not acknowledged",
                static_cast<double>(session.unacknowledged_critical), real(limits.max_unacknowledged_critical_alarms),
                "");
  judge.at_least("require_inside_95", "true error at the target inside the predicted 95 % region",
                 yes_or_no(target ? target->inside : std::nullopt),
                 limits.require_inside_95 ? std::optional(1.0) : std::nullopt, "");
  judge.at_least("require_verified", "registration verified before navigation",
                 yes_or_no(session.verified_before_navigation),
                 limits.require_verified ? std::optional(1.0) : std::nullopt, "");
  return std::move(judge.out);
}

bool all_hold(const std::vector<Judgement> &judgements) {
  return std::all_of(judgements.begin(), judgements.end(), [](const Judgement &one) { return one.holds; });
}

} // namespace bregma::cli::report
