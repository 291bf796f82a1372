// The distortion field from images of the simulated phantom: control points against the truth, the residual (14) at
// points held out, and the field against the simulator's true map, for no and for many air bubbles. The paper's chain
// alone, with sub-voxel search and lattice, and with the true points.
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/mri/grid/grid_points.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "algorithms/registration/points/paired_points.hpp"
#include "bench/accuracy/mri_parts.hpp"
#include "bench/accuracy/mri_session.hpp"
#include "bench/accuracy/registration_study.hpp"

namespace bregma::bench {

namespace {

using namespace sim::scanner;
using geometry::Points3;

constexpr double kQuickCt = 3.0; // times the voxels of the paper's CT

struct Errors {
  std::vector<double> mean_mm, max_mm; // of each run
  void add(const std::vector<double> &run) {
    double sum = 0.0;
    for (const double e : run) {
      sum += e / static_cast<double>(run.size());
    }
    mean_mm.push_back(sum);
    max_mm.push_back(run.empty() ? std::nan("") : *std::max_element(run.begin(), run.end()));
  }
  [[nodiscard]] double mean() const {
    double sum = 0.0;
    for (const double m : mean_mm) {
      sum += m / static_cast<double>(mean_mm.size());
    }
    return mean_mm.empty() ? std::nan("") : sum;
  }
  [[nodiscard]] double max() const {
    return max_mm.empty() ? std::nan("") : *std::max_element(max_mm.begin(), max_mm.end());
  }
};

// How a set of control points does.
struct ChainFigures {
  int runs = 0, fields = 0;
  std::vector<double> matched, wrong;
  Errors points, residual, map;
};

Points3 points_of(const std::vector<Vector3d> &list) {
  Points3 out(3, static_cast<Eigen::Index>(list.size()));
  for (std::size_t i = 0; i < list.size(); ++i) {
    out.col(static_cast<Eigen::Index>(i)) = list[i];
  }
  return out;
}

// Distance of each found point from the nearest true one; farther than half a cell: wrong.
std::vector<double> distances(const Points3 &found, const Points3 &real, double cell_mm, int *wrong) {
  std::vector<double> out;
  for (const auto &p : found.colwise()) {
    const double d = (real.colwise() - p).colwise().norm().minCoeff();
    d < 0.5 * cell_mm ? out.push_back(d) : void(++*wrong);
  }
  return out;
}

// real, imaged: matched control points, real in the frame of imaged.
void add_field(ChainFigures &out, const Points3 &real, const Points3 &imaged, const SimulatedScanner &scanner,
               const Acquisition &acquisition, const std::vector<Vector3d> &probes) {
  const auto field = mri::DistortionField::fit(real, imaged);
  const auto residual = mri::hold_out(real, imaged);
  if (!field || !residual) {
    return;
  }
  ++out.fields;
  out.residual.mean_mm.push_back(residual->overall.mean_mm);
  out.residual.max_mm.push_back(residual->overall.max_mm);
  // The real points were placed by least squares, which takes the rigid part of the distortion with them.
  std::vector<Vector3d> placed, device;
  const std::vector<Vector3d> &crossings = scanner.truth().crossings_mm;
  for (Eigen::Index i = 0; i < real.cols(); ++i) {
    const auto nearest =
        std::min_element(crossings.begin(), crossings.end(), [&](const Vector3d &a, const Vector3d &b) {
          return (a - real.col(i)).squaredNorm() < (b - real.col(i)).squaredNorm();
        });
    placed.emplace_back(real.col(i));
    device.push_back(*nearest);
  }
  const auto T = registration::fit_rigid(device, placed);
  if (!T) {
    return;
  }
  std::vector<double> errors;
  for (const Vector3d &p : probes) {
    errors.push_back((field->to_imaged(*T * p) - acquisition.believed_mm(p)).norm());
  }
  out.map.add(errors);
}

void add_chain(ChainFigures &out, const Points3 &ct, const Points3 &mr, const SimulatedScanner &scanner,
               const Acquisition &acquisition, const Points3 &imaged_truth, double cell_mm,
               const std::vector<Vector3d> &probes) {
  ++out.runs;
  int wrong = 0;
  out.points.add(distances(mr, imaged_truth, cell_mm, &wrong));
  out.wrong.push_back(wrong);
  const mri::MatchResult match = mri::match_points(ct, mr);
  out.matched.push_back(match.outcome == mri::MatchOutcome::kMatched ? static_cast<double>(match.pairs.size()) : 0.0);
  if (match.outcome == mri::MatchOutcome::kMatched) {
    add_field(out, match.reference_points(ct), match.imaged_points(mr), scanner, acquisition, probes);
  }
}

double mean_of(const std::vector<double> &v) {
  double sum = 0.0;
  for (const double x : v) {
    sum += x / static_cast<double>(v.size());
  }
  return v.empty() ? std::nan("") : sum;
}

void report_chain(Report &report, const std::string &name, const ChainFigures &f, bool required) {
  report.add(figure(name + ", control points matched of 1,331", mean_of(f.matched), ""));
  report.add(figure(name + ", wrong control points", mean_of(f.wrong), ""));
  report.add(figure(name + ", fields", 100.0 * f.fields / std::max(1, f.runs), "%"));
  const auto add = [&](const char *what, double value, double limit) {
    report.add(required ? at_most(name + what, value, "mm", limit) : figure(name + what, value, "mm"));
  };
  add(", control points in MR against the truth, mean", f.points.mean(), 0.15);
  report.add(with_peer(required ? at_most(name + ", residual (14), mean", f.residual.mean(), "mm", 0.20)
                                : figure(name + ", residual (14), mean", f.residual.mean(), "mm"),
                       0.29, "paper"));
  report.add(with_peer(required ? at_most(name + ", residual (14), largest", f.residual.max(), "mm", 0.7)
                                : figure(name + ", residual (14), largest", f.residual.max(), "mm"),
                       1.47, "paper"));
  add(", against the true map, mean", f.map.mean(), 0.10);
  add(", against the true map, largest", f.map.max(), 0.5);
}

} // namespace

void field_from_images(Report &report, const MriBenchOptions &options) {
  const int seeds = options.seeds > 0 ? options.seeds : options.quick ? 1 : 20;
  const double ct_coarser = options.quick ? kQuickCt : 1.0;
  struct Variant {
    const char *name;
    int bubbles;
    FieldKind kind;
  };
  std::vector<Variant> variants{{"no bubbles", 0, FieldKind::kHarmonics}};
  if (!options.quick) {
    variants.push_back({"5 bubbles", 5, FieldKind::kHarmonics});
    variants.push_back({"10 bubbles", 10, FieldKind::kHarmonics});
    variants.push_back({"20 bubbles", 20, FieldKind::kHarmonics});
    variants.push_back({"field of bumps", 0, FieldKind::kBumps});
  }
  report.note(
      "The field from images of the simulated phantom (1,331 crossings, distortion 1.20 mm in the mean, 4.14 at "
      "most). Control points: of the paper's chain alone; with sub-voxel search and lattice; true ones. Against "
      "the true map: at the centres of the cells. The CT has the paper's voxels; --quick: three times as large, and "
      "no bubbles.");
  Progress progress("field", seeds * static_cast<int>(variants.size()));
  std::vector<ChainFigures> chain(variants.size()), repaired(variants.size()), truth(variants.size());
  Errors ct_errors;
  for (int seed = 1; seed <= seeds; ++seed) {
    mri::GridOptions grid;
    const PhantomDesign design;
    const double cell_mm = design.pitch_mm();
    grid.cell_mm = cell_mm;
    grid.bar_mm = design.bar_mm;
    grid.bright = true;
    // The phantom in CT is the same for all variants.
    const auto ct = mri::find_grid_points(SimulatedScanner({}, static_cast<std::uint64_t>(seed)).ct(ct_coarser), grid);
    grid.bright = false;
    for (std::size_t b = 0; b < variants.size(); ++b, progress.step()) {
      ScannerOptions scanner_options;
      scanner_options.errors.bubbles = variants[b].bubbles;
      scanner_options.field.kind = variants[b].kind;
      SimulatedScanner scanner(scanner_options, static_cast<std::uint64_t>(seed));
      const StackPlan plan = scanner.phantom_plan();
      const Acquisition acquisition(scanner.field(), phantom_protocol(), plan);
      const auto mr = mri::find_grid_points(scanner.phantom(phantom_protocol(), plan), grid);
      if (!mr || !ct) {
        ++repaired[b].runs;
        ++chain[b].runs;
        continue;
      }
      const std::vector<Vector3d> &crossings = scanner.truth().crossings_mm;
      std::vector<Vector3d> imaged, in_ct, probes;
      const auto T_ct_device = scanner.truth().T_ct_phantom * scanner.truth().T_device_phantom.inverse();
      const Eigen::Matrix3d axes = cell_mm * scanner.truth().T_device_phantom.rotation_matrix();
      const Vector3d middle = scanner.truth().T_device_phantom.translation();
      const double half = 0.5 * (design.bars - 1) * cell_mm;
      for (const Vector3d &p : crossings) {
        imaged.push_back(acquisition.believed_mm(p));
        in_ct.push_back(T_ct_device * p);
        const Vector3d centre = p + 0.5 * (axes.col(0) + axes.col(1) + axes.col(2));
        if ((axes.transpose() * (centre - middle) / cell_mm).cwiseAbs().maxCoeff() < half) {
          probes.push_back(centre);
        }
      }
      const Points3 imaged_truth = points_of(imaged), ct_truth = points_of(in_ct);
      if (b == 0) {
        int wrong = 0;
        ct_errors.add(distances(ct->points_mm, ct_truth, cell_mm, &wrong));
      }
      add_chain(chain[b], ct->chain_mm, mr->chain_mm, scanner, acquisition, imaged_truth, cell_mm, probes);
      add_chain(repaired[b], ct->points_mm, mr->points_mm, scanner, acquisition, imaged_truth, cell_mm, probes);
      add_chain(truth[b], ct_truth, imaged_truth, scanner, acquisition, imaged_truth, cell_mm, probes);
    }
  }
  // With --quick the voxels are larger than those that the limit is for.
  const std::string ct_name = "field, control points in CT against the truth, mean";
  report.add(options.quick ? figure(ct_name, ct_errors.mean(), "mm") : at_most(ct_name, ct_errors.mean(), "mm", 0.08));
  for (std::size_t b = 0; b < variants.size(); ++b) {
    const std::string name = std::string("field, ") + variants[b].name;
    report_chain(report, name + ", with lattice", repaired[b], true);
    report_chain(report, name + ", the paper's chain alone", chain[b], false);
    report_chain(report, name + ", true points", truth[b], false);
  }
}

} // namespace bregma::bench
