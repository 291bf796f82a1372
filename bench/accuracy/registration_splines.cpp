// Figures of thin-plate splines.
#include <cmath>
#include <optional>
#include <random>
#include <string>

#include "algorithms/registration/splines/spline_grid.hpp"
#include "bench/accuracy/registration_parts.hpp"
#include "bench/accuracy/registration_study.hpp"
#include "tests/unit/algorithms/tables.hpp"

namespace bregma::bench {

namespace {

using namespace registration;
using geometry::Points3;

Points3 bent(const Points3 &p) {
  Points3 out = p;
  for (Eigen::Index i = 0; i < p.cols(); ++i) {
    for (int d = 0; d < 3; ++d) {
      out(d, i) += 4.0 * std::sin(p((d + 1) % 3, i) / 35.0 + d) * std::cos(p(d, i) / 60.0);
    }
  }
  return out;
}

void fit_figures(Report &report, bool quick) {
  std::mt19937 rng(kStudySeed);
  std::uniform_real_distribution<double> side(-100.0, 100.0);
  const auto box = [&](Eigen::Index count) { return Points3::NullaryExpr(3, count, [&] { return side(rng); }).eval(); };
  const Points3 probes = box(2000);
  for (const auto &[kernel, name] :
       {std::pair(SplineKernel::kR2LogR, std::string("r2lnr")), std::pair(SplineKernel::kR, std::string("r"))}) {
    SplineOptions options;
    options.kernel = kernel;
    double before = 0.0;
    for (const Eigen::Index count : {125, 1000, 5000}) {
      if (quick && count > 1000) {
        continue;
      }
      const Points3 centres = box(count);
      const Points3 values = bent(centres);
      std::optional<ThinPlateSpline<3>> spline;
      const double ms = milliseconds([&] { spline = *ThinPlateSpline<3>::fit(centres, values, options); });
      const std::string label = "spline." + name + "." + std::to_string(count);
      if (count > 125) {
        report.add(at_most(label + ".fit", 1e-3 * ms, "s", count == 1000 ? 0.3 : 15.0));
        report.add(at_most(label + ".at_centres", (spline->map(centres) - values).cwiseAbs().maxCoeff(), "mm", 1e-6));
      }
      const double hold_out = std::sqrt((spline->map(probes) - bent(probes)).colwise().squaredNorm().mean());
      Record record = figure(label + ".hold_out", hold_out, "mm");
      report.add(before > 0.0 ? with_peer(record, before, "fewer centres") : record);
      before = hold_out;
      if (count == 1000) {
        const Points3 affine = (Eigen::Matrix3d::Identity() * 1.1 * centres).colwise() + Eigen::Vector3d(5.0, 6.0, 7.0);
        const Points3 expected = (1.1 * probes).colwise() + Eigen::Vector3d(5.0, 6.0, 7.0);
        report.add(
            at_most(label + ".affine",
                    (ThinPlateSpline<3>::fit(centres, affine, options)->map(probes) - expected).cwiseAbs().maxCoeff(),
                    "mm", 1e-9));
        const double direct = milliseconds([&] { (void)spline->map(probes); });
        const Eigen::Vector3d corner = Eigen::Vector3d::Constant(100.0);
        std::optional<SplineGrid<3>> grid;
        const double built = milliseconds([&] { grid.emplace(*spline, -corner, corner, 5.0, 2); });
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        constexpr int kRounds = 200;
        const double sampled = milliseconds([&] {
          for (int round = 0; round < kRounds; ++round) {
            for (Eigen::Index i = 0; i < probes.cols(); ++i) {
              sum += (*grid)(probes.col(i));
            }
          }
        });
        const double rate = 1e-3 * kRounds * static_cast<double>(probes.cols()) / sampled;
        report.add(with_peer(at_least(label + ".grid_rate", std::isfinite(sum.sum()) ? rate : 0.0, "10^6/s", 1.0),
                             1e-3 * static_cast<double>(probes.cols()) / direct, "without the grid"));
        report.add(figure(label + ".grid_5mm.largest_error", grid->largest_error_mm(), "mm"));
        report.add(figure(label + ".grid_5mm.build", 1e-3 * built, "s"));
      }
    }
  }
}

// Leave-one-out over the 336 marker pairs of the MRI distortion toolkit's phantom. The peers are the figures supplied
// with the data, for a plain spline.
void marker_figures(Report &report) {
  if (!is_present(report, kShared / "distortion/repeat")) {
    return;
  }
  const auto file = kShared / "distortion/repeat/Matched_Markers.csv";
  const Points3 distorted = test::read_points<3>(file, 1, 1);
  const Points3 truth = test::read_points<3>(file, 1, 5);
  SplineOptions options;
  options.leave_one_out = true;
  report.add(with_peer(figure("distortion.leave_one_out.r2lnr",
                              ThinPlateSpline<3>::fit(distorted, truth, options)->leave_one_out_mm().mean(), "mm"),
                       0.383, "plain spline"));
  options.kernel = SplineKernel::kR;
  report.add(with_peer(figure("distortion.leave_one_out.r",
                              ThinPlateSpline<3>::fit(distorted, truth, options)->leave_one_out_mm().mean(), "mm"),
                       0.494, "plain spline"));
}

} // namespace

void spline_figures(Report &report, const RegistrationBenchOptions &options) {
  fit_figures(report, options.quick);
  marker_figures(report);
}

} // namespace bregma::bench
