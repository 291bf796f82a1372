// The robot's registration over many runs: predicted against true errors, pillars, image quality, faults, and time.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <span>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "bench/accuracy/mri_parts.hpp"
#include "bench/accuracy/mri_runs.hpp"
#include "bench/accuracy/mri_session.hpp"
#include "bench/accuracy/registration_study.hpp"
#include "drivers/sim/random.hpp"

namespace bregma::bench {

namespace {

using namespace sim::scanner;
using mri::RegistrationVerdict;
using Run = PillarRun;

} // namespace

void robot_coverage(Report &report, const MriBenchOptions &options) {
  const int runs = seeds_of(options, 1000, 6);
  const int per_field = options.quick ? 3 : 50; // runs that share a field
  report.note(
      "Predicted error at the target (registration and field), against its true position: part of the runs within "
      "the 95 % region. Every run has its own images, frame, noise and place; 50 runs share a field, which was mapped "
      "from points found in images. 36 slices of 128 pixels around the coils, as large as the paper's.");
  int inside = 0, inside_half = 0, found = 0, fields = 0;
  std::vector<double> errors, predicted;
  std::unique_ptr<MriSession> mapped;
  ScannerOptions scanner;
  scanner.fine_groups = {"mid-top", "mid-bottom"};
  const Protocol protocol = small_protocol(36);
  Progress progress("coverage", runs);
  for (int run = options.first; run < options.first + runs; ++run, progress.step()) {
    if ((run - options.first) % per_field == 0) {
      mapped = std::make_unique<MriSession>(ScannerOptions{}, 1000000 + static_cast<std::uint64_t>(run));
      const bool mapped_well = mapped->map_field(options.quick ? ControlPoints::kDisturbed : ControlPoints::kImages);
      fields += mapped_well ? 1 : 0;
      mapped = mapped_well ? std::move(mapped) : nullptr;
    }
    if (mapped == nullptr) {
      continue;
    }
    MriSession session(scanner, 10000 + static_cast<std::uint64_t>(run), *mapped);
    const Run one(session, {"mid"}, protocol, 36, Images::kOurs);
    if (one.result.verdict == RegistrationVerdict::kFound) {
      const TargetError e = target_error(session, one.result.T_base_device);
      ++found;
      inside += e.covered() ? 1 : 0;
      inside_half += e.mahalanobis <= uncertainty::chi_square_upper_quantile(0.5, 3.0) ? 1 : 0;
      errors.push_back(e.error_mm.norm());
      predicted.push_back(e.bound_95_mm);
    }
  }
  const double percent = 100.0 / std::max(1, found);
  report.add(figure("coverage: fields mapped", fields, ""));
  report.add(figure("coverage: registrations found", 100.0 * found / runs, "%"));
  report.add(figure("coverage: mean true error at the target", average(errors), "mm"));
  report.add(figure("coverage: mean predicted 95 % error at the target", average(predicted), "mm"));
  report.add(figure("coverage: true error within the 50 % region", percent * inside_half, "%"));
  report.add(
      at_least("coverage: true error within the 95 % region", percent * inside, "%", options.quick ? 50.0 : 93.0));
  report.add(
      at_most("coverage: true error within the 95 % region", percent * inside, "%", options.quick ? 100.0 : 97.0));
}

namespace {

// The field outside the phantom of 171 mm: the error that it states against the true map, at the coils of the outer
// pillars and at random places up to 25 mm outside. Both kinds of fields.
// The quick sample draws what is far from the coils coarsely.
ScannerOptions around_pillars(const MriBenchOptions &options) {
  ScannerOptions out;
  if (options.quick) {
    out.fine_groups = {"mid-top", "mid-bottom", "outer-top", "outer-bottom"};
  }
  return out;
}

void outside_the_phantom(Report &report, int seeds) {
  for (const auto &[kind, kind_name] : {std::pair{FieldKind::kHarmonics, "harmonics"}, {FieldKind::kBumps, "bumps"}}) {
    int known = 0, covered = 0, asked = 0;
    std::vector<double> errors, stated;
    for (int seed = 1; seed <= seeds; ++seed) {
      ScannerOptions options;
      options.field.kind = kind;
      MriSession session(options, static_cast<std::uint64_t>(seed));
      if (!session.map_field()) {
        continue;
      }
      const mri::DistortionField &field = *session.field();
      const Truth &truth = session.scanner().truth();
      const Acquisition acquisition(session.scanner().field(), phantom_protocol(), session.scanner().phantom_plan());
      // The field's true positions are those of Device but for the rigid part of the distortion.
      std::vector<Vector3d> device, placed;
      for (const Vector3d &p : truth.crossings_mm) {
        if (const auto real = field.to_true(acquisition.believed_mm(p))) {
          device.push_back(p);
          placed.push_back(*real);
        }
      }
      const auto T = registration::fit_rigid(device, placed);
      if (!T) {
        continue;
      }
      std::vector<Vector3d> places;
      for (const int coil : session.coils_of({"outer-top", "outer-bottom"})) {
        places.push_back(truth.coils_device_mm[static_cast<std::size_t>(coil)]);
      }
      sim::Random random(static_cast<std::uint64_t>(seed), "outside");
      while (places.size() < 108) {
        const Vector3d p(random.uniform(-111, 111), random.uniform(-111, 111), random.uniform(-111, 111));
        if (p.cwiseAbs().maxCoeff() > 88.0) {
          places.emplace_back(truth.T_device_phantom * p);
        }
      }
      for (const Vector3d &p : places) {
        const Vector3d at = *T * p;
        const auto assessed = field.assess(at);
        ++asked;
        if (assessed.coverage == mri::Coverage::kExtrapolates) {
          const double error = (field.to_imaged(at) - acquisition.believed_mm(p)).norm();
          ++known;
          covered += error <= assessed.error_95_mm ? 1 : 0;
          errors.push_back(error);
          stated.push_back(assessed.error_95_mm);
        }
      }
    }
    const std::string name = std::string("outside the phantom, field of ") + kind_name;
    report.add(figure(name + ", places where it is known", 100.0 * known / std::max(1, asked), "%"));
    report.add(figure(name + ", error", average(errors), "mm"));
    report.add(figure(name + ", stated 95 % error", average(stated), "mm"));
    report.add(at_least(name + ", error within the stated 95 %", 100.0 * covered / std::max(1, known), "%", 90.0));
  }
}

} // namespace

void robot_pillars(Report &report, const MriBenchOptions &options) {
  const int seeds = seeds_of(options, 20, 1);
  outside_the_phantom(report, seeds);
  report.note("Pillars: the outer ones stand outside the phantom of 171 mm; 15 bars make a phantom of 239 mm.");
  for (const int bars : options.quick ? std::vector<int>{} : std::vector<int>{11, 15}) {
    for (const std::vector<std::string> &pillars : {std::vector<std::string>{"mid"}, std::vector<std::string>{"outer"},
                                                    std::vector<std::string>{"mid", "outer"}}) {
      Study study;
      for (int seed = 1; seed <= seeds; ++seed) {
        ScannerOptions scanner;
        scanner.phantom.bars = bars;
        MriSession session(scanner, static_cast<std::uint64_t>(seed));
        if (session.map_field()) {
          add_run(study, session, Run(session, pillars, coil_protocol(60), 60, Images::kOurs).result);
        }
      }
      std::string name = bars == 11 ? "phantom 171 mm, " : "phantom 239 mm, ";
      name += pillars.size() == 2 ? "all 16" : "8 " + pillars.front();
      add_study(report, name, study);
    }
  }
}

void robot_quality(Report &report, const MriBenchOptions &options) {
  const int seeds = seeds_of(options, 10, 1);
  const auto study_of = [&](const ScannerOptions &scanner, double thickness_mm) {
    Study study;
    for (int seed = 1; seed <= seeds; ++seed) {
      MriSession session(scanner, static_cast<std::uint64_t>(seed));
      Protocol protocol = coil_protocol(60);
      protocol.thickness_mm = thickness_mm;
      if (session.map_field()) {
        add_run(
            study, session,
            Run(session, {"mid"}, protocol, static_cast<int>(std::lround(90.0 / thickness_mm)), Images::kOurs).result);
      }
    }
    return study;
  };
  const auto curve = [](const char *name, const char *colour, bool dashed) {
    return base::Series{name, colour, base::Mark::kLine, {}, 2.0, dashed, 1.0};
  };
  base::Plot thick, noisy;
  thick.title = "Errors over the thickness of the slices";
  thick.x = {"thickness of the slices, mm", false, 0.0, 5.5};
  noisy.title = "Errors over the SNR";
  noisy.x = {"SNR of water", true, 4.0, 60.0};
  for (base::Plot *plot : {&thick, &noisy}) {
    plot->y = {"mm", false, 0.0, std::nullopt};
    plot->series = {curve("TRE, mean", base::colour::kBlue, false),
                    curve("TRE, 95 % of runs", base::colour::kBlue, true),
                    curve("FRE, mean", base::colour::kOrange, false)};
  }
  const auto draw = [](base::Plot &plot, double x, const Study &study) {
    std::vector<double> tre = study.tre_mm;
    plot.series[0].points.push_back({x, average(study.tre_mm)});
    plot.series[1].points.push_back({x, percentile(tre, 0.95)});
    plot.series[2].points.push_back({x, average(study.fre_mm)});
  };
  for (const double thickness : {1.0, 1.5, 2.0, 3.0, 4.0, 5.0}) {
    if (options.quick) {
      continue;
    }
    const Study study = study_of({}, thickness);
    char name[64];
    std::snprintf(name, sizeof name, "slices of %.1f mm", thickness);
    add_study(report, name, study);
    draw(thick, thickness, study);
    report.add(figure(std::string(name) + ", TRE over thickness", average(study.tre_mm) / thickness, ""));
    // The repetition time of the paper's 60 slices holds 60 slices; fewer need less.
    report.add(figure(std::string(name) + ", scan time", 0.528 * std::max(1.0, 90.0 / thickness / 60.0) * 192.0, "s"));
  }
  for (const double snr : {5.0, 10.0, 20.0, 50.0}) {
    if (options.quick && snr != 5.0) {
      continue;
    }
    ScannerOptions scanner;
    scanner.appearance.snr = snr;
    const Study study = study_of(scanner, 1.5);
    draw(noisy, snr, study);
    add_study(report, "SNR " + std::to_string(static_cast<int>(snr)), study);
  }
  write_picture(options, "scanner_thickness", thick);
  write_picture(options, "scanner_snr", noisy);
}

namespace {

// Off the isocentre; the target is in it, where its own field is none.
const Vector3d kBall_mm(25, 10, -15);
constexpr double kBallRadius_mm = 60.0;

struct Fault {
  const char *name;
  std::function<void(MriSession &)> before;       // the scans
  std::function<void(MriSession &, Run &)> after; // they were made
};

std::vector<Fault> faults() {
  const auto nothing = [](MriSession &) {};
  const auto leave = [](MriSession &, Run &) {};
  const auto lose = [](int coils) {
    return [coils](MriSession &session) {
      const char *names[] = {"mid-top-1", "mid-bottom-3", "mid-top-4", "mid-bottom-1", "mid-top-2"};
      for (int i = 0; i < coils; ++i) {
        session.scanner().break_coil(static_cast<std::size_t>(session.frame().find(names[i])));
      }
    };
  };
  return {
      {"one coil lost", lose(1), leave},
      {"three coils lost", lose(3), leave},
      {"five coils lost", lose(5), leave},
      {"top and bottom cables swapped", nothing,
       [](MriSession &, Run &run) { std::swap(run.top->scan.on, run.bottom->scan.on); }},
      {"saturated image", nothing,
       [](MriSession &, Run &run) {
         for (float &v : run.top->foreground.voxels) {
           v = std::min(v, 900.0F);
         }
       }},
      {"background and foreground exchanged", nothing,
       [](MriSession &, Run &run) { std::swap(run.top->background.voxels, run.top->foreground.voxels); }},
      {"wrong series", nothing,
       [](MriSession &session, Run &run) {
         run.bottom = session.scan(coil_protocol(60), pillar_plan(false), {"outer-bottom"});
         run.bottom->scan.on = session.coils_of({"mid-bottom"});
       }},
      {"mixed orientations", nothing,
       [](MriSession &session, Run &run) {
         run.bottom =
             session.scan(coil_protocol(60), plan_of(Plane::kTransverse, Vector3d(0, 0, 0), 60), {"mid-bottom"});
       }},
      {"frame moved between the scans", nothing,
       [](MriSession &session, Run &run) {
         const BodyPose before = session.scanner().truth().T_device_base;
         session.scanner().move_frame({before.rotation(), before.translation() + Vector3d(4, 2, 0)});
         run.bottom = session.scan(coil_protocol(60), pillar_plan(false), {"mid-bottom"});
         session.scanner().move_frame(before);
       }},
      {"1 ppm after mapping", [](MriSession &session) { session.scanner().enter_ball(1.0, kBall_mm, kBallRadius_mm); },
       leave},
      {"3 ppm after mapping", [](MriSession &session) { session.scanner().enter_ball(3.0, kBall_mm, kBallRadius_mm); },
       leave},
  };
}

} // namespace

void robot_faults(Report &report, const MriBenchOptions &options) {
  const int seeds = seeds_of(options, 20, 1);
  report.note(
      "Faults: refused, or found with a correct remainder. Wrong: found, with an error at the target beyond its 95 % "
      "bound and 3 mm.");
  int wrong = 0;
  std::vector<Fault> list = faults();
  if (options.quick) { // one that is found, one that is refused, one that is not known
    list = {list[0], list[3], list.back()};
  }
  for (const Fault &fault : list) {
    int found = 0;
    double worst = 0.0;
    int within = 0;
    std::string reason;
    for (int seed = 1; seed <= seeds; ++seed) {
      MriSession session(around_pillars(options), 500 + static_cast<std::uint64_t>(seed));
      if (!session.map_field()) {
        continue;
      }
      fault.before(session);
      const int slices = options.quick ? 36 : 60;
      Run run(session, {"mid"}, options.quick ? small_protocol(slices) : coil_protocol(slices), slices, Images::kOurs);
      fault.after(session, run);
      run.evaluate(session, Images::kOurs);
      if (run.result.verdict == RegistrationVerdict::kFound) {
        const TargetError e = target_error(session, run.result.T_base_device);
        ++found;
        worst = std::max(worst, e.error_mm.norm());
        within += e.covered() ? 1 : 0;
        wrong += e.error_mm.norm() > e.bound_95_mm && e.error_mm.norm() > 3.0 ? 1 : 0;
      } else {
        reason = run.result.reason;
      }
    }
    report.add(figure(std::string("fault: ") + fault.name + ", found", 100.0 * found / seeds, "%"));
    if (found > 0) {
      report.add(figure(std::string("fault: ") + fault.name + ", worst error at the target", worst, "mm"));
      report.add(figure(std::string("fault: ") + fault.name + ", within the predicted 95 % region",
                        100.0 * within / found, "%"));
    }
    if (!reason.empty()) {
      report.note(std::string("  ") + fault.name + ": " + reason);
    }
  }
  report.add(at_most("faults: wrong registrations called found", wrong, "", 0.0));
}

void robot_polarity(Report &report, const MriBenchOptions &options) {
  const int seeds = seeds_of(options, 20, 1);
  report.note("Current in one direction, and the mean of both: mid pillars, target's true position.");
  if (options.quick) {
    report.note("Left out of the quick sample.");
    return;
  }
  Study one, both;
  for (int seed = 1; seed <= seeds; ++seed) {
    MriSession session({}, static_cast<std::uint64_t>(seed));
    if (!session.map_field()) {
      continue;
    }
    Run run(session, {"mid"}, coil_protocol(60), 60, Images::kOurs);
    add_run(one, session, run.result);
    const mri::Stack top = session.scanner().foreground(coil_protocol(60), pillar_plan(true), {"mid-top"}, -1);
    const mri::Stack bottom = session.scanner().foreground(coil_protocol(60), pillar_plan(false), {"mid-bottom"}, -1);
    run.top->scan.opposite = &top;
    run.bottom->scan.opposite = &bottom;
    run.evaluate(session, Images::kOurs);
    add_run(both, session, run.result);
  }
  add_study(report, "one polarity", one);
  add_study(report, "both polarities", both);
  report.add(figure("gain by both polarities, FRE", average(one.fre_mm) - average(both.fre_mm), "mm"));
  report.add(figure("gain by both polarities, TRE", average(one.tre_mm) - average(both.tre_mm), "mm"));
}

void robot_time(Report &report, const MriBenchOptions & /*options*/) {
  MriSession session({}, 1);
  report.add(
      at_most("time: field from 1,331 control points", milliseconds([&] { session.map_field(); }), "ms", 1000.0));
  Run run(session, {"mid", "inner"}, coil_protocol(60), 60, Images::kOurs);
  std::vector<double> times, processor;
  for (int i = 0; i < 5; ++i) {
    const std::clock_t start = std::clock();
    times.push_back(milliseconds([&] { run.evaluate(session, Images::kOurs); }));
    processor.push_back(1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  report.add(figure("time: registration of a batch of 240 slices, of the processor", percentile(processor, 0.5), "ms"));
  report.add(with_peer(at_most("time: registration of a batch of 240 slices", percentile(times, 0.5), "ms", 250.0),
                       1750.0, "paper, MATLAB"));

  // Slices one by one: what is left when the last one of the second scan has come.
  std::vector<double> left, slice;
  for (int i = 0; i < 5; ++i) {
    const std::vector<mri::CoilScan> scans{run.top->scan, run.bottom->scan};
    const mri::RobotRegistrationOptions o = session.options(Images::kOurs, mri::CoilMethod::kMultiSlice);
    const auto top = mri::find_artefacts(run.top->background, run.top->foreground, o.artefacts);
    auto finder = mri::ArtefactFinder::start(run.bottom->background, o.artefacts);
    const mri::Stack &stack = run.bottom->foreground;
    const std::size_t pixels = stack.pixels() / static_cast<std::size_t>(stack.size[2]);
    const auto add = [&](int k) { finder->add(k, std::span(stack.voxels).subspan(stack.offset(0, 0, k), pixels)); };
    for (int k = 0; k + 1 < stack.size[2]; ++k) {
      slice.push_back(milliseconds([&] { add(k); }));
    }
    left.push_back(milliseconds([&] {
      add(stack.size[2] - 1);
      const std::vector<std::vector<mri::CoilArtefact>> artefacts{top->artefacts, finder->finish()->artefacts};
      run.result = mri::register_artefacts(session.frame(), scans, artefacts, o);
    }));
  }
  report.add(figure("time: slice of a foreground, as it comes", percentile(slice, 0.5), "ms"));
  report.add(at_most("time: registration after the last slice", percentile(left, 0.5), "ms", 50.0));
}

} // namespace bregma::bench
