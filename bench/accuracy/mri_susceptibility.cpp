// A susceptibility that enters the bore after the field was mapped: does the predicted error cover what it does, and do
// the coils that verify show it? docs/scanner.md.
#include <algorithm>
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
  int covered = 0;                               // by the prediction of the registration alone
  int answered[2] = {0, 0};                      // at each target: refused, alarmed, or covered after verification
  int answered_one[2] = {0, 0};                  // in images of one read-out, after opposed ones
  std::vector<double> error_mm, offset_mm;       // at the tree; of the coils that verify
  std::vector<double> b0_change_mm;              // largest at a coil
  std::vector<double> accepted_mm, predicted_mm; // error and its 95 % bound of what was not refused
  std::vector<double> one_mm, one_predicted_mm;  // the same in images of one read-out

  void answer_all() {
    for (int *count : {&answered[0], &answered[1], &answered_one[0], &answered_one[1]}) {
      ++*count;
    }
  }
};

void one_run(Outcome &out, double ppm, ReadOuts read_outs, std::uint64_t seed) {
  ScannerOptions scanner;
  scanner.fine_groups = {"mid-top", "mid-bottom", "tree"};
  MriSession session(scanner, seed);
  if (!session.map_field(ControlPoints::kDisturbed, read_outs)) {
    return;
  }
  sim::Random random(seed, "ball");
  const Vector3d centre(random.uniform(-70, 70), random.uniform(-70, 70), random.uniform(-70, 70));
  const double radius = random.uniform(30.0, 60.0);
  if (ppm != 0.0) {
    session.scanner().enter_ball(ppm, centre, radius);
  }
  ++out.runs;
  const PillarRun run(session, {"mid"}, small_protocol(36), 36, Images::kOurs);
  if (run.result.verdict != mri::RegistrationVerdict::kFound) {
    ++out.refused;
    return out.answer_all();
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
  const mri::B0Change b0 =
      mri::b0_change(found.value_or(std::vector<mri::LocatedCoil>()), run.result.coils, T.pose, options.mapped_b0);
  out.b0_change_mm.push_back(b0.max_mm);
  if (!verification.failure.empty()) {
    ++out.alarmed;
    return out.answer_all();
  }
  T.covariance.bottomRightCorner<3, 3>() += verification.unexplained;
  const TargetError verified = target_error(session, T);
  out.accepted_mm.push_back(verified.error_mm.norm());
  out.predicted_mm.push_back(verified.bound_95_mm);
  out.answered[0] += verified.covered() ? 1 : 0;
  out.answered[1] += target_error(session, T, kOffTheTree).covered() ? 1 : 0;
  if (read_outs == ReadOuts::kOpposed) {
    T.covariance.bottomRightCorner<3, 3>() += b0.second_moment;
    const TargetError one = target_error(session, T, kTarget, ReadOuts::kOne);
    out.one_mm.push_back(one.error_mm.norm());
    out.one_predicted_mm.push_back(one.bound_95_mm);
    out.answered_one[0] += one.covered() ? 1 : 0;
    out.answered_one[1] += target_error(session, T, kOffTheTree, ReadOuts::kOne).covered() ? 1 : 0;
  }
}

void add_figures(Report &report, const std::string &name, Outcome &out, double ppm, ReadOuts read_outs,
                 double limit_percent) {
  const double percent = 100.0 / std::max(1, out.runs);
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
  report.add(at_least(name + ", answered at " + kTarget, percent * out.answered[0], "%", limit_percent));
  report.add(figure(name + ", answered at " + kOffTheTree, percent * out.answered[1], "%"));
  if (read_outs == ReadOuts::kOne) {
    return;
  }
  report.add(figure(name + ", largest change of B0 at a coil", average(out.b0_change_mm), "mm"));
  const std::string in_one = name + ", images of one read-out";
  report.add(figure(in_one + ", error at " + kTarget, average(out.one_mm), "mm"));
  report.add(figure(in_one + ", error at " + kTarget + ", 95 % of runs", percentile(out.one_mm, 0.95), "mm"));
  report.add(figure(in_one + ", predicted 95 % error after verification", average(out.one_predicted_mm), "mm"));
  report.add(at_least(in_one + ", answered at " + kTarget, percent * out.answered_one[0], "%", limit_percent));
  report.add(figure(in_one + ", answered at " + kOffTheTree, percent * out.answered_one[1], "%"));
}

} // namespace

void robot_susceptibility(Report &report, const MriBenchOptions &options) {
  const int runs = seeds_of(options, 64, 1);
  const std::vector<double> sizes = options.quick ? std::vector<double>{3.0} : std::vector<double>{0.0, 1.0, 2.0, 3.0};
  report.note(
      "A ball of another susceptibility (radius 30 to 60 mm, anywhere within 70 mm of the isocentre along each axis) "
      "enters after the field was mapped. Answered: refused, alarmed by the coils that verify, or covered by the "
      "region of 95 % that is stated after verification. Opposed read-outs: phantom, coils and target are scanned "
      "twice, the second time with the read-out reversed, and their places averaged.");
  base::Plot plot;
  plot.title = "Error at the target over the susceptibility that entered";
  plot.x = {"susceptibility, ppm", false, 0.0, 3.2};
  plot.y = {"mm", false, 0.0, std::nullopt};
  const auto curve = [](const char *name, const char *colour, bool dashed) {
    return base::Series{name, colour, base::Mark::kLine, {}, 2.0, dashed, 1.0};
  };
  plot.series = {
      curve("one read-out, mean", base::colour::kOrange, false), curve("95 % of runs", base::colour::kOrange, true),
      curve("opposed read-outs, mean", base::colour::kBlue, false), curve("95 % of runs", base::colour::kBlue, true)};
  Progress progress("susceptibility", 2 * static_cast<int>(sizes.size()) * runs);
  for (const ReadOuts read_outs : {ReadOuts::kOne, ReadOuts::kOpposed}) {
    for (const double ppm : options.quick &&read_outs == ReadOuts::kOne ? std::vector<double>{} : sizes) {
      Outcome out;
      for (int run = 0; run < runs; ++run, progress.step()) {
        one_run(out, ppm, read_outs,
                700000 + static_cast<std::uint64_t>(options.first) + static_cast<std::uint64_t>(run));
      }
      const std::size_t first = read_outs == ReadOuts::kOne ? 0 : 2;
      plot.series[first].points.push_back({ppm, average(out.error_mm)});
      plot.series[first + 1].points.push_back({ppm, percentile(out.error_mm, 0.95)});
      const std::string name = std::to_string(static_cast<int>(ppm)) + " ppm after mapping" +
                               (read_outs == ReadOuts::kOne ? "" : ", opposed read-outs");
      add_figures(report, name, out, ppm, read_outs, options.quick ? 0.0 : 93.0);
    }
  }
  write_picture(options, "scanner_susceptibility", plot);
}

} // namespace bregma::bench
