// The thesis' experiments in the plane: tables 4.2 and 5.1 to 5.4, and what its formulas leave open.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <iomanip>
#include <limits>
#include <sstream>

#include "algorithms/intensity/resolution.hpp"
#include "bench/accuracy/intensity_parts.hpp"

namespace bregma::bench {

namespace {

using intensity::AigReading;
using intensity::Feature;
using intensity::Measure;
using intensity::MeasureOptions;
using intensity::Volume;

int error_of(Measure measure, const Volume &reference, const Volume &floating, const MeasureOptions &options,
             const Sweep &sweep) {
  parallel::Team team(bench_threads());
  return std::abs(largest_at(*intensity::make_measure(measure, reference, floating, options, team), sweep));
}
int signed_error(Measure measure, const Volume &reference, const Volume &floating, const MeasureOptions &options,
                 const Sweep &sweep) {
  parallel::Team team(bench_threads());
  return largest_at(*intensity::make_measure(measure, reference, floating, options, team), sweep);
}

struct Errors {
  double sum = 0.0;
  double worst = 0.0;
  int count = 0;
  void take(int error) {
    sum += error;
    worst = std::max(worst, static_cast<double>(error));
    ++count;
  }
  [[nodiscard]] double mean() const { return sum / count; }
};

std::string number(double value, int digits) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(digits) << value;
  return out.str();
}

// The functional-looking image that is not in the data: each region of the atlas with an activity of its own, blurred.
Volume made_spect(const IntensityOptions &options, unsigned seed) {
  Volume labels = load_volume(options.labels);
  std::mt19937_64 rng(20260410); // the same activity on both dates
  std::vector<float> activity(256);
  for (float &a : activity) {
    a = static_cast<float>(0.6 + 0.4 * uniform(rng));
  }
  activity[0] = 0.0F;
  for (float &v : labels.voxels) {
    v = activity[static_cast<std::size_t>(std::clamp(v, 0.0F, 255.0F))];
  }
  parallel::Team team(bench_threads());
  return with_noise(plane_of(intensity::smoothed(labels, 4.0, team), kSlice_mm), 0.002, seed);
}

// The second date that is not in the data: another gain, a lesion, and noise.
Volume second_date(Volume image, unsigned seed) {
  for (std::size_t i = 0; i < image.voxels.size(); ++i) {
    const Eigen::Vector3d p = image.pixel_mm(i) - Eigen::Vector3d(30.0, 20.0, 0.0);
    const double lesion = 0.3 * std::exp(-p.squaredNorm() / (2.0 * 10.0 * 10.0));
    image.voxels[i] = std::clamp(0.9F * image.voxels[i] + static_cast<float>(lesion), 0.0F, 1.0F);
  }
  return with_noise(std::move(image), 0.0003, seed);
}

// One row of tables 5.1 to 5.4: NMI as printed, and MF-MI on the grid and off it.
struct PlanePair {
  std::string name;
  const Volume &reference, &floating;
  double thesis_nmi, thesis_mf;
};
void add_feature_row(Report &report, const PlanePair &pair, const Sweep &sweep) {
  const std::string unit = sweep.rotation ? "deg" : "pixels";
  const auto add = [&](Measure measure, const MeasureOptions &how, const std::string &name, double thesis) {
    const double at = signed_error(measure, pair.reference, pair.floating, how, sweep);
    report.add(with_peer(figure(pair.name + " " + name, at, unit), thesis, "thesis"));
  };
  add(Measure::kNmi, as_printed(), "NMI as printed", pair.thesis_nmi);
  add(Measure::kMfMi, well_made(), "MF-MI", pair.thesis_mf);
  add(Measure::kMfMi, off_grid(), "MF-MI off grid", pair.thesis_mf);
}

} // namespace

void plane_noise_figures(Report &report, const IntensityOptions &options) {
  const Planes planes(options);
  const int seeds = options.quick ? 3 : 20;
  report.note("Table 4.2: CT/T1, noise on T1 in [0, 1], rotation -60 to 60 deg by 1, 256 x 256 pixels of 1 mm, " +
              std::to_string(seeds) +
              " seeds; mean and worst error; printed: 256 bins, nearest, corners of zeros; "
              "well made: 64 bins, Parzen, overlap only; off grid: the same, samples moved within their pixels");
  constexpr std::array kVariance{0.01, 0.02, 0.03, 0.04, 0.05};
  constexpr std::array<std::array<double, 3>, 5> kThesis{{{3, 1, 1}, {8, 2, 1}, {10, 2, 3}, {25, 2, 2}, {31, 2, 3}}};
  constexpr std::array kMeasure{Measure::kNmi, Measure::kGmi, Measure::kAmi};
  Progress progress("table 4.2", static_cast<int>(kVariance.size()) * seeds);
  std::vector<std::string> table{"# variance | thesis NMI GMI AMI | printed NMI GMI AMI | well made NMI GMI AMI | off "
                                 "grid NMI GMI AMI (mean/worst deg)"};
  for (std::size_t row = 0; row < kVariance.size(); ++row) {
    std::array<std::array<Errors, 3>, 3> errors;
    for (int seed = 0; seed < seeds; ++seed) {
      const Volume noisy =
          with_noise(planes.t1, kVariance[row], static_cast<unsigned>(100 * row) + static_cast<unsigned>(seed));
      for (std::size_t m = 0; m < 3; ++m) {
        errors[0][m].take(error_of(kMeasure[m], planes.ct, noisy, as_printed(), {true, 60}));
        errors[1][m].take(error_of(kMeasure[m], planes.ct, noisy, well_made(), {true, 60}));
        errors[2][m].take(error_of(kMeasure[m], planes.ct, noisy, off_grid(), {true, 60}));
      }
      progress.step();
    }
    std::string line = number(kVariance[row], 2) + " |";
    for (const double thesis : kThesis[row]) {
      line += " " + number(thesis, 0);
    }
    constexpr std::array kWay{" printed ", " well made ", " off grid "};
    for (std::size_t way = 0; way < kWay.size(); ++way) {
      line += " |";
      for (std::size_t m = 0; m < 3; ++m) {
        line += " " + number(errors[way][m].mean(), 1) + "/" + number(errors[way][m].worst, 0);
        const std::string name =
            "table 4.2 " + number(kVariance[row], 2) + kWay[way] + std::string(intensity::name_of(kMeasure[m]));
        report.add(with_peer(figure(name + " mean", errors[way][m].mean(), "deg"), kThesis[row][m], "thesis"));
        report.add(figure(name + " worst", errors[way][m].worst, "deg"));
      }
    }
    table.push_back(line);
  }
  for (const std::string &line : table) {
    report.note(line);
  }
}

// What the thesis leaves open in (35): the scale of the gradient beside the grey value, and how the gradient of a noisy
// image is taken. Noise beyond the thesis' is added, as at its levels every reading is near the pair's own best
// rotation.
void significance_figures(Report &report, const IntensityOptions &options) {
  const Planes planes(options);
  const int seeds = options.quick ? 2 : 20;
  report.note(
      "AMI's readings: CT/T1 as in table 4.2, off grid, noise beyond the thesis', " + std::to_string(seeds) +
      " seeds; mean and worst error (deg). Gradient of the image smoothed by sigma pixels, times a weight, plus "
      "the grey value; weight 0 is NMI");
  struct Reading {
    double sigma, weight;
  };
  constexpr std::array<Reading, 8> kReadings{{{0, 0}, {0, 1}, {1, 1}, {2, 1}, {3, 1}, {2, 0.5}, {2, 2}, {2, 4}}};
  parallel::Team team(bench_threads());
  const auto significant = [&team](const Volume &image, const Reading &reading) {
    Volume out = image;
    if (reading.weight > 0.0) {
      const std::vector<float> slope = intensity::gradient_magnitude(
          reading.sigma > 0.0 ? intensity::smoothed(image, reading.sigma, team) : image, team);
      for (std::size_t i = 0; i < slope.size(); ++i) {
        out.voxels[i] += static_cast<float>(reading.weight) * slope[i];
      }
    }
    return out;
  };
  constexpr std::array kVariance{0.01, 0.03, 0.05, 0.1, 0.2};
  Progress progress("readings of AMI", static_cast<int>(kVariance.size()) * seeds);
  for (const double variance : kVariance) {
    std::array<Errors, kReadings.size()> errors;
    for (int seed = 0; seed < seeds; ++seed) {
      const Volume noisy = with_noise(planes.t1, variance, 7000U + static_cast<unsigned>(seed));
      for (std::size_t r = 0; r < kReadings.size(); ++r) {
        errors[r].take(error_of(Measure::kNmi, significant(planes.ct, kReadings[r]), significant(noisy, kReadings[r]),
                                off_grid(), {true, 60}));
      }
      progress.step();
    }
    for (std::size_t r = 0; r < kReadings.size(); ++r) {
      const std::string name = "AMI at " + number(variance, 2) + ", sigma " + number(kReadings[r].sigma, 0) +
                               ", weight " + number(kReadings[r].weight, 1);
      report.add(figure(name + " mean", errors[r].mean(), "deg"));
      report.add(figure(name + " worst", errors[r].worst, "deg"));
    }
  }
}

void plane_feature_figures(Report &report, const IntensityOptions &options) {
  const Planes planes(options);
  const Volume spect = made_spect(options, 1);
  const Volume later_ct = second_date(planes.ct, 2);
  const Volume later_t2 = second_date(planes.t2, 3);
  const Volume later_spect = second_date(made_spect(options, 4), 5);
  report.note("Tables 5.1 and 5.2: -90 to 90 deg and pixels by 1. SPECT is made from the atlas (a random activity per "
              "region, blurred by 4 mm, noise), and second dates by gain, a lesion and noise: neither is in the data. "
              "Off grid: samples moved within their pixels, so that the grids coincide at no angle");
  for (const bool rotation : {true, false}) {
    const std::string table = rotation ? "table 5.1 " : "table 5.2 ";
    for (const PlanePair &pair : {PlanePair{table + "CT/T2", planes.ct, planes.t2, 0, 0},
                                  {table + "T2/PD", planes.t2, planes.pd, 0, 0},
                                  {table + "PD/SPECT", planes.pd, spect, rotation ? 2.0 : 0.0, 0},
                                  {table + "CT/CT", planes.ct, later_ct, 0, 0},
                                  {table + "T2/T2", planes.t2, later_t2, 0, 0},
                                  {table + "SPECT/SPECT", spect, later_spect, 0, 0}}) {
      add_feature_row(report, pair, {rotation, 90});
    }
  }
  report.note("Table 5.3: CT/T2, noise on T2, rotation");
  constexpr std::array<std::array<double, 3>, 5> kNoise{
      {{0.0001, -1, 0}, {0.0003, -1, 0}, {0.002, -1, 0}, {0.007, -1, 0}, {0.01, -2, 0}}};
  for (const auto &[variance, thesis_nmi, thesis_mf] : kNoise) {
    const Volume noisy = with_noise(planes.t2, variance, 7);
    add_feature_row(report, {"table 5.3 " + number(variance, 4), planes.ct, noisy, thesis_nmi, thesis_mf}, {true, 90});
  }
  report.note("Table 5.4: CT/T2, T2 with a smaller field of view, rotation");
  constexpr std::array<std::array<double, 3>, 5> kField{{{90, 0, 0}, {80, 0, 0}, {70, -1, 0}, {60, -1, 1}, {50, 1, 1}}};
  for (const auto &[field, thesis_nmi, thesis_mf] : kField) {
    const Volume part = with_field_of_view(planes.t2, field / 100.0);
    add_feature_row(report, {"table 5.4 " + number(field, 0) + " %", planes.ct, part, thesis_nmi, thesis_mf},
                    {true, 90});
  }
}

void reading_figures(Report &report, const IntensityOptions &options) {
  const Planes planes(options);
  const int seeds = options.quick ? 1 : 5;
  report.note("Readings of the adaptive image gradient, and combinations of features, in MF-MI: mean error over the "
              "pairs T1/T2, T2/PD, T1/PD, noise variance 0.002 and 0.01, -60 to 60 deg, " +
              std::to_string(seeds) + " seeds");
  const std::vector<std::pair<const Volume *, const Volume *>> pairs{
      {&planes.t1, &planes.t2}, {&planes.t2, &planes.pd}, {&planes.t1, &planes.pd}};
  const auto mean_error = [&](const MeasureOptions &how) {
    Errors errors;
    for (const auto &[reference, floating] : pairs) {
      for (const double variance : {0.002, 0.01}) {
        for (int seed = 0; seed < seeds; ++seed) {
          errors.take(error_of(Measure::kMfMi, *reference,
                               with_noise(*floating, variance, 300U + static_cast<unsigned>(seed)), how, {true, 60}));
        }
      }
    }
    return errors.mean();
  };
  for (const auto &[reading, name] :
       {std::pair(AigReading::kPrinted, "printed"), std::pair(AigReading::kDistance, "distance"),
        std::pair(AigReading::kDistanceTimesSlope, "distance x slope"),
        std::pair(AigReading::kDistanceTimesGrey, "distance x grey")}) {
    MeasureOptions how = well_made();
    how.aig = reading;
    how.features = {Feature::kAig};
    report.add(figure(std::string("AIG alone, ") + name, mean_error(how), "deg"));
  }
  for (const auto &[features, name] : std::vector<std::pair<std::vector<Feature>, std::string>>{
           {{Feature::kGrey}, "grey"},
           {{Feature::kGrey, Feature::kAig}, "grey + AIG"},
           {{Feature::kGrey, Feature::kGradient}, "grey + gradient"},
           {{Feature::kGrey, Feature::kStandardDeviation}, "grey + standard deviation"},
           {{Feature::kGrey, Feature::kCorners}, "grey + corners"},
           {{Feature::kGrey, Feature::kGradient, Feature::kAig}, "grey + gradient + AIG"}}) {
    MeasureOptions how = well_made();
    how.features = features;
    report.add(figure("features " + name, mean_error(how), "deg"));
  }
}

void variant_figures(Report &report, const IntensityOptions &options) {
  const Planes planes(options);
  report.note("Every measure in the plane, CT/T1 without and T1/T2 with noise (0.01): -60 to 60 deg. Figures of table "
              "2.2 are of other images and tasks: Q-MI 1.07 mm CT/MR; GI-MI 1.37 mm CT/T1; RMI 174 s, 92 %, 1.25 mm "
              "CT/X-ray; cMI 10,610 s; LLE-HE 156.2 ms, over 90 %");
  const Volume noisy = with_noise(planes.t2, 0.01, 9);
  MeasureOptions how = well_made();
  how.bins = 32;
  for (const intensity::MeasureName &m : intensity::kMeasures) {
    const std::string name(m.name);
    const auto began = std::chrono::steady_clock::now();
    report.add(figure(name + " CT/T1", signed_error(m.measure, planes.ct, planes.t1, how, {true, 60}), "deg"));
    report.add(figure(name + " T1/T2 with noise", signed_error(m.measure, planes.t1, noisy, how, {true, 60}), "deg"));
    const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count();
    report.add(figure(name + " per comparison, with preparation", ms / (2 * 121), "ms"));
  }
}

} // namespace bregma::bench
