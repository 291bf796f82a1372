#include "bench/accuracy/registration_basin.hpp"

#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/surface/local_surface.hpp"

namespace bregma::bench {

namespace {

constexpr unsigned kBasinSeed = 20260302;
constexpr std::size_t kBasinSamples = 150;
constexpr double kBasinSuccess_mm = 2.0;
constexpr int kAngles = 19;    // 0 to 180 degrees
constexpr int kDistances = 11; // 0 to 100 mm
constexpr double kStepAngle = 10.0;
constexpr double kStep_mm = 10.0;
constexpr int kCell = 34; // pixels

// Colour map from white (no run succeeds) to deep blue (all succeed).
std::string colour(double fraction) {
  const auto mix = [fraction](double none, double all) { return static_cast<int>(none + fraction * (all - none)); };
  std::ostringstream out;
  out << "rgb(" << mix(255, 18) << ',' << mix(250, 70) << ',' << mix(240, 130) << ')';
  return out.str();
}

} // namespace

void draw_basin(Report &report, const Head &head, const surface::SurfaceField &field, const std::string &file,
                int runs) {
  registration::LocalOptions options;
  options.correlation_length_mm = 0.0;
  registration::LocalRegistration local(field, options);
  std::ostringstream cells;
  double near = 100.0;
  const int left = 70;
  const int top = 50;
  Progress progress("convergence basin", kDistances * kAngles);
  for (int d = 0; d < kDistances; ++d) {
    for (int a = 0; a < kAngles; ++a) {
      progress.step();
      std::mt19937 rng(kBasinSeed + static_cast<unsigned>(a + kAngles * d));
      int successes = 0;
      for (int run = 0; run < runs; ++run) {
        const Trace trace = take_trace(side_of(head, kBasinSamples, run % 2 == 0, rng), 1.0, Noise::kAll, rng);
        const PairedPose start = perturbed_start(trace.T_target_source, field.surface().centre_mm(),
                                                 a * kStepAngle * geometry::kRadiansPerDegree, d * kStep_mm, rng);
        successes += trace.rmse_mm(local.fit(trace.source_mm, start).T_target_source) <= kBasinSuccess_mm ? 1 : 0;
      }
      const double fraction = static_cast<double>(successes) / runs;
      if (a <= 3 && d <= 3) {
        near = std::min(near, 100.0 * fraction);
      }
      const int x = left + a * kCell;
      const int y = top + (kDistances - 1 - d) * kCell;
      cells << "<rect x='" << x << "' y='" << y << "' width='" << kCell << "' height='" << kCell << "' fill='"
            << colour(fraction) << "'/><text x='" << x + kCell / 2 << "' y='" << y + kCell / 2 + 4
            << "' text-anchor='middle' fill='" << (fraction > 0.5 ? "white" : "black") << "'>"
            << std::lround(100.0 * fraction) << "</text>\n";
    }
  }
  std::ofstream out(file);
  const int width = left + kAngles * kCell + 20;
  const int bottom = top + kDistances * kCell;
  out << "<svg xmlns='http://www.w3.org/2000/svg' width='" << width << "' height='" << bottom + 60
      << "' font-family='sans-serif' font-size='11'>\n<rect width='100%' height='100%' fill='white'/>\n<text x='"
      << left << "' y='20' font-size='14'>Local surface registration: % of " << runs
      << " starts that end within 2 mm</text>\n<text x='" << left << "' y='38'>" << kBasinSamples
      << " samples of one side of the scalp, noise 1 mm, seed " << kBasinSeed << "</text>\n"
      << cells.str();
  for (int a = 0; a < kAngles; a += 3) {
    out << "<text x='" << left + a * kCell + kCell / 2 << "' y='" << bottom + 18 << "' text-anchor='middle'>"
        << a * kStepAngle << "</text>\n";
  }
  for (int d = 0; d < kDistances; d += 2) {
    out << "<text x='" << left - 8 << "' y='" << top + (kDistances - 1 - d) * kCell + kCell / 2 + 4
        << "' text-anchor='end'>" << d * kStep_mm << "</text>\n";
  }
  out << "<text x='" << left + kAngles * kCell / 2 << "' y='" << bottom + 42
      << "' text-anchor='middle' font-size='13'>rotation off the truth, degrees</text>\n<text x='20' y='"
      << top + kDistances * kCell / 2 << "' text-anchor='middle' font-size='13' transform='rotate(-90 20 "
      << top + kDistances * kCell / 2 << ")'>translation off the truth, mm</text>\n</svg>\n";
  if (!out.flush()) {
    throw std::runtime_error(file + ": cannot be written");
  }
  report.note("the convergence basin is drawn in " + file + ", " + std::to_string(runs) + " starts a cell");
  report.add(figure("surface.local.basin.within_30deg_30mm.lowest_cell", near, "%"));
}

} // namespace bregma::bench
