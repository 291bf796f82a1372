// A susceptibility that enters the bore after the field was mapped: does the predicted error cover what it does, and do
// the coils that verify show it? docs/scanner.md.
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/accuracy/mri_runs.hpp"

namespace bregma::bench {

namespace {

using namespace sim::scanner;

constexpr const char *kOffTheTree = "inner-top-1"; // a target away from the coils that verify

// Of one size of the susceptibility, over the runs.
struct Outcome {
  int runs = 0, refused = 0, alarmed = 0;
  int covered = 0;                                    // by the prediction of the registration alone
  int answered[2] = {0, 0};                           // at each target: refused, alarmed, or covered after verification
  std::vector<double> error_mm, offset_mm;            // at the tree; of the coils that verify
  std::vector<base::PlotPoint> errors_over_offset[2]; // without, with an alarm
  std::vector<double> accepted_mm, predicted_mm;      // error and its 95 % bound of what was not refused
};

void one_run(Outcome &out, double ppm, std::uint64_t seed) {
  ScannerOptions scanner;
  scanner.fine_groups = {"mid-top", "mid-bottom", "tree"};
  MriSession session(scanner, seed);
  if (!session.map_field()) {
    return;
  }
  sim::Random random(seed, "ball");
  const Vector3d centre(random.uniform(-70, 70), random.uniform(-70, 70), random.uniform(-70, 70));
  const double radius = random.uniform(30.0, 60.0);
  if (ppm != 0.0) {
    session.scanner().set_field(with_ball(session.scanner().field(), ppm, centre, radius));
  }
  ++out.runs;
  const PillarRun run(session, {"mid"}, small_protocol(36), 36, Images::kOurs);
  if (run.result.verdict != mri::RegistrationVerdict::kFound) {
    ++out.refused;
    ++out.answered[0];
    ++out.answered[1];
    return;
  }
  auto T = run.result.T_base_device;
  const TargetError alone = target_error(session, T);
  out.error_mm.push_back(alone.error_mm.norm());
  out.covered += alone.covered() ? 1 : 0;

  const mri::RobotRegistrationOptions options = session.options(Images::kOurs, mri::CoilMethod::kMultiSlice);
  const auto tree = session.scan(small_protocol(60), tree_plan(Plane::kCoronal), {"tree"});
  const auto found = mri::locate_targets(session.frame(), tree->scan, run.result, options);
  const mri::Verification verification =
      mri::verify_registration(session.frame(), found.value_or(std::vector<mri::LocatedCoil>()), 5, T, run.result.coils,
                               mri::unit_axes(tree->background), options);
  out.offset_mm.push_back(verification.offset_mm.norm());
  out.errors_over_offset[verification.failure.empty() ? 0 : 1].push_back(
      {verification.offset_mm.norm(), alone.error_mm.norm()});
  if (!verification.failure.empty()) {
    ++out.alarmed;
    ++out.answered[0];
    ++out.answered[1];
    return;
  }
  T.covariance.bottomRightCorner<3, 3>() += verification.unexplained;
  const TargetError verified = target_error(session, T);
  out.accepted_mm.push_back(verified.error_mm.norm());
  out.predicted_mm.push_back(verified.bound_95_mm);
  out.answered[0] += verified.covered() ? 1 : 0;
  out.answered[1] += target_error(session, T, kOffTheTree).covered() ? 1 : 0;
}

} // namespace

void robot_susceptibility(Report &report, const MriBenchOptions &options) {
  const int runs = seeds_of(options, 100, 2);
  report.note(
      "A ball of another susceptibility (radius 30 to 60 mm, anywhere within 70 mm of the isocentre along each axis) "
      "enters after the field was mapped. Answered: refused, alarmed by the coils that verify, or covered by the "
      "region of 95 % that is stated after verification.");
  base::Plot plot;
  plot.title = "Error at the target over the offset of the coils that verify";
  plot.x = {"offset of the coils that verify, mm", false, 0.0, std::nullopt};
  plot.y = {"true error at the target, mm", false, 0.0, std::nullopt};
  plot.series = {{"accepted", base::colour::kBlue, base::Mark::kPoints, {}, 2.0, false, 1.0},
                 {"alarm", base::colour::kOrange, base::Mark::kPoints, {}, 2.0, false, 1.0}};
  Progress progress("susceptibility", 4 * runs);
  for (const double ppm : {0.0, 1.0, 2.0, 3.0}) {
    Outcome out;
    for (int run = 0; run < runs; ++run, progress.step()) {
      one_run(out, ppm, 700000 + static_cast<std::uint64_t>(options.first) + static_cast<std::uint64_t>(run));
    }
    for (std::size_t i = 0; i < 2; ++i) {
      plot.series[i].points.insert(plot.series[i].points.end(), out.errors_over_offset[i].begin(),
                                   out.errors_over_offset[i].end());
    }
    const double percent = 100.0 / std::max(1, out.runs);
    const std::string name = std::to_string(static_cast<int>(ppm)) + " ppm after mapping";
    report.add(figure(name + ", error at " + kTarget, average(out.error_mm), "mm"));
    report.add(figure(name + ", error at " + kTarget + ", 95 % of runs", percentile(out.error_mm, 0.95), "mm"));
    report.add(figure(name + ", offset of the coils that verify", average(out.offset_mm), "mm"));
    report.add(figure(name + ", covered by the registration alone", percent * out.covered, "%"));
    report.add(figure(name + ", refused", percent * out.refused, "%"));
    const std::string alarmed = name + ", alarmed by the coils that verify";
    report.add(ppm == 0.0 ? at_most(alarmed, percent * out.alarmed, "%", 2.0)
                          : figure(alarmed, percent * out.alarmed, "%"));
    report.add(figure(name + ", largest error without alarm", percentile(out.accepted_mm, 1.0), "mm"));
    report.add(figure(name + ", predicted 95 % error after verification", average(out.predicted_mm), "mm"));
    report.add(at_least(name + ", answered at " + kTarget, percent * out.answered[0], "%", options.quick ? 0.0 : 93.0));
    report.add(figure(name + ", answered at " + kOffTheTree, percent * out.answered[1], "%"));
  }
  write_picture(options, "scanner_susceptibility", plot);
}

} // namespace bregma::bench
