// The distortion field: table 3 on the markers of a real phantom, left out one at a time, and times. docs/mri.md.
#include <cstdint>
#include <cstdio>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algorithms/mri/correction.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "bench/accuracy/mri_parts.hpp"
#include "bench/accuracy/registration_study.hpp"
#include "tests/unit/algorithms/tables.hpp"
#include "tests/unit/mri/field_phantom.hpp"

namespace bregma::bench {

namespace {

using Eigen::Index;
using geometry::Points3;

void row(Report &report, const char *axis, const mri::ErrorSummary::Row &before, const mri::ErrorSummary::Row &after,
         const char *paper) {
  char text[160];
  std::snprintf(text, sizeof text, "%-4s %5.2f (%4.2f) %6.2f   %5.2f (%4.2f) %6.2f   %s", axis, before.mean_mm,
                before.deviation_mm, before.max_mm, after.mean_mm, after.deviation_mm, after.max_mm, paper);
  report.note(text);
}

// Everything that a fit chooses is chosen without the marker that is left out. --quick: every sixth marker.
void left_out(Report &report, bool quick) {
  const auto file = kShared / "distortion/repeat/Matched_Markers.csv";
  if (!is_present(report, file)) {
    return;
  }
  const Points3 imaged = test::read_points<3>(file, 1, 1), truth = test::read_points<3>(file, 1, 5);
  const Index step = quick ? 6 : 1;
  std::vector<Index> tested;
  Points3 errors(3, (truth.cols() + step - 1) / step);
  Progress progress("markers left out", static_cast<int>(errors.cols()));
  for (Index i = 0; i < truth.cols(); i += step, progress.step()) {
    std::vector<Index> kept;
    for (Index j = 0; j < truth.cols(); ++j) {
      if (j != i) {
        kept.push_back(j);
      }
    }
    const auto field = mri::DistortionField::fit(truth(Eigen::all, kept), imaged(Eigen::all, kept));
    errors.col(static_cast<Index>(tested.size())) = mri::residuals(field.value(), truth.col(i), imaged.col(i)).col(0);
    tested.push_back(i);
  }
  const mri::ErrorSummary before = mri::summarise((imaged - truth)(Eigen::all, tested));
  const mri::ErrorSummary after = mri::summarise(errors);
  report.note("Real phantom, 336 markers; residual of each when left out. Last columns: table 3 of the paper.");
  report.note(
      "axis initial mean (SD) max   residual mean (SD) max   paper: initial mean (SD) max; residual mean (SD) max");
  row(report, "x", before.axis[0], after.axis[0], "0.68 (0.66) 4.13; 0.17 (0.16) 1.29");
  row(report, "y", before.axis[1], after.axis[1], "0.59 (0.44) 2.36; 0.10 (0.09) 0.96");
  row(report, "z", before.axis[2], after.axis[2], "0.51 (0.49) 2.57; 0.15 (0.15) 1.22");
  row(report, "e", before.overall, after.overall, "1.20 (0.72) 4.14; 0.29 (0.20) 1.47");
  report.add(
      with_peer(at_most("distortion.left_out.mean", after.overall.mean_mm, "mm", 0.37), 0.383, "spline r^2 ln r"));
  report.add(figure("distortion.left_out.max", after.overall.max_mm, "mm"));
  report.add(figure("distortion.wrong_pairs", static_cast<double>(mri::wrong_pairs(truth, imaged).size()), ""));
}

void simulated(Report &report) {
  const test::SourceField truth(11, 2.5);
  const Points3 points = test::lattice(11, 16.0); // 1,331
  const Points3 imaged = test::with_noise(truth.image_of(points), 0.15, 2);
  std::optional<mri::DistortionField> field;
  const double fit = milliseconds([&] { field = *mri::DistortionField::fit(points, imaged); });
  report.add(at_most("distortion.field_of_1331_points", 1e-3 * fit, "s", 1.0));
  Points3 errors(3, 0);
  const Points3 probes = test::lattice(9, 19.3, {3.1, -2.2, 1.7});
  errors.resize(3, probes.cols());
  for (Index i = 0; i < probes.cols(); ++i) {
    const Eigen::Vector3d p = probes.col(i);
    errors.col(i) = field->to_imaged(p) - truth.image_of(p);
  }
  const mri::ErrorSummary error = mri::summarise(errors);
  report.add(at_most("distortion.against_the_true_map.mean", error.overall.mean_mm, "mm", 0.10));
  report.add(at_most("distortion.against_the_true_map.max", error.overall.max_mm, "mm", 0.5));

  const mri::FieldTable table(*field, 4.0, 24.0, 2);
  report.add(figure("distortion.table_error", table.table_error_mm(), "mm"));
  mri::PlaneGeometry plane;
  plane.columns = plane.rows = 256;
  plane.T_field_index << 0.7, 0.0, 0.0, -89.0, 0.0, 0.0, 1.5, 40.0, 0.0, -0.7, 0.0, 89.0, 0.0, 0.0, 0.0, 1.0;
  std::optional<mri::PlaneCorrection> correction;
  report.add(
      figure("correction.first_slice_of_a_plane", milliseconds([&] { correction.emplace(table, plane, true); }), "ms"));
  const std::vector<std::uint16_t> image(65536, 1000);
  const std::vector<std::span<const std::uint16_t>> stack(9, image);
  std::vector<std::uint16_t> out(image.size());
  std::vector<double> times;
  for (int i = 0; i < 50; ++i) {
    times.push_back(milliseconds([&] { correction->apply<std::uint16_t>(stack, 4, out); }));
  }
  report.add(at_most("correction.slice_256x256.median", percentile(times, 0.5), "ms", 1.0));
  constexpr int kPoints = 100000;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  const double each = milliseconds([&] {
    for (int i = 0; i < kPoints; ++i) {
      sum += table.to_true({0.001 * i - 50.0, 20.0, -30.0}).value_or(Eigen::Vector3d::Zero());
    }
  });
  report.add(figure("correction.point", sum.allFinite() ? 1e3 * each / kPoints : 0.0, "us"));
}

} // namespace

void distortion_figures(Report &report, const MriBenchOptions &options) {
  simulated(report);
  left_out(report, options.quick);
}

} // namespace bregma::bench
