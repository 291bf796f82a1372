// Accuracy of the whole chain: the demo's operation, from pivot calibration to the target, for 20 seeds. The simulated
// room, the daemon's stages and the scenario are those of the demo. Only time is virtual.
//
// One reading per seed: the probe's state in the middle of its hold at the target, as displayed, compared with the
// ground truth of the same frame.
#include <algorithm>
#include <cmath>
#include <future>
#include <iostream>
#include <sstream>
#include <vector>

#include <CLI/CLI.hpp>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "bench/record.hpp"
#include "idl/names.hpp"
#include "tests/support/virtual_operation.hpp"

namespace {

using namespace bregma;

constexpr std::uint64_t kFirstSeed = 1;
constexpr double kHeld_mm = 2.0; // the probe is at the target below this displayed distance
constexpr double kStill_mm_s = 3.0;

struct Reading {
  Eigen::Vector3d error_mm;
  Eigen::Matrix3d covariance;
};

struct Outcome {
  std::string failure;
  double error_mm = std::nan("");
  double predicted_mm = std::nan("");
  bool inside = false;
  double mean_error_mm = std::nan(""); // error of the mean over the hold, which averages out the markers' noise
  double inside_share = 0.0;           // fraction of all frames of the hold
  double fre_mm = std::nan("");
};

Outcome operate(const casefile::Case &a_case, const sim::Scenario &scenario, std::uint64_t seed) {
  test::VirtualOperation operation(a_case, scenario, seed);
  std::vector<Reading> readings;
  Outcome out;
  operation.observe([&](const wire::NavigationState &state, const wire::SimulatedTruth *truth) {
    const double speed = Eigen::Vector3d::Map(state.velocity_mm_s).norm();
    if (state.status != bregma_wire_POSE_LIVE || truth == nullptr || !(state.distance_to_target_mm < kHeld_mm) ||
        !(speed < kStill_mm_s)) {
      return;
    }
    out.fre_mm = operation.registration().fre_mm; // available while the case is open
    for (std::uint32_t i = 0; i < truth->tool_count; ++i) {
      if (wire::view(truth->tools[i].tool) == wire::view(state.tool)) {
        const Eigen::Vector3d tip = Eigen::Vector3d::Map(state.T_image_tip.translation_mm);
        const Eigen::Matrix<double, 6, 6, Eigen::RowMajor> covariance =
            Eigen::Matrix<double, 6, 6, Eigen::RowMajor>::Map(state.covariance);
        readings.push_back({tip - Eigen::Vector3d::Map(truth->tools[i].T_image_tip.translation_mm),
                            uncertainty::tre_covariance(covariance, tip)});
      }
    }
  });
  if (!operation.run()) {
    out.failure = operation.failure();
    return out;
  }
  if (readings.empty()) {
    out.failure = "the probe was never shown at the target";
    return out;
  }
  const auto inside = [](const Reading &reading) {
    return uncertainty::mahalanobis_squared(reading.covariance, reading.error_mm) <=
           uncertainty::chi_square_upper_quantile(0.05, 3);
  };
  const Reading &reading = readings[readings.size() / 2];
  out.error_mm = reading.error_mm.norm();
  out.predicted_mm = uncertainty::rms_mm(reading.covariance);
  out.inside = inside(reading);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Reading &one : readings) {
    mean += one.error_mm / static_cast<double>(readings.size());
    out.inside_share += (inside(one) ? 1.0 : 0.0) / static_cast<double>(readings.size());
  }
  out.mean_error_mm = mean.norm();
  return out;
}

template <class Member> std::vector<double> collect(const std::vector<Outcome> &outcomes, Member member) {
  std::vector<double> values;
  for (const Outcome &outcome : outcomes) {
    if (outcome.failure.empty()) {
      values.push_back(static_cast<double>(outcome.*member));
    }
  }
  return values;
}

} // namespace

int main(int argc, char **argv) {
  bench::Options options;
  std::string case_folder = "out/cases/colin27";
  std::string scenario_file = "demo/colin27/scenario.toml";
  CLI::App app("Accuracy of the whole chain over seeds of the demo's operation");
  bench::add_options(app, options);
  app.add_option("--case", case_folder, "case folder")->capture_default_str();
  app.add_option("--scenario", scenario_file, "scenario")->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  const auto a_case = casefile::load_case(case_folder);
  const auto scenario = sim::load_scenario(scenario_file);
  if (!a_case || !scenario) {
    std::cerr << "bench_chain: " << (a_case ? scenario.error().message : a_case.error().message) << '\n';
    return 2;
  }
  const std::uint64_t seeds = options.quick ? 4 : 20;
  bench::Report report(options.json);
  report.note("seeds " + std::to_string(kFirstSeed) + " to " + std::to_string(kFirstSeed + seeds - 1) +
              "; one reading per seed, in the middle of the hold at the target");

  std::vector<Outcome> outcomes(seeds);
  for (std::uint64_t i = 0; i < seeds; i += 2) { // two seeds at a time
    auto second = std::async(std::launch::async, [&] {
      if (i + 1 < seeds) {
        outcomes[i + 1] = operate(*a_case, *scenario, kFirstSeed + i + 1);
      }
    });
    outcomes[i] = operate(*a_case, *scenario, kFirstSeed + i);
    second.wait();
    for (std::uint64_t j = i; j < std::min(i + 2, seeds); ++j) {
      std::ostringstream line;
      line.precision(3);
      line << "seed " << kFirstSeed + j << ": ";
      if (outcomes[j].failure.empty()) {
        line << "error " << outcomes[j].error_mm << " mm, predicted RMS " << outcomes[j].predicted_mm << " mm, "
             << (outcomes[j].inside ? "inside" : "OUTSIDE") << " the 95 %; mean over the hold "
             << outcomes[j].mean_error_mm << " mm; FRE " << outcomes[j].fre_mm << " mm";
      } else {
        line << "FAILED: " << outcomes[j].failure;
      }
      report.note(line.str());
    }
  }
  auto errors = collect(outcomes, &Outcome::error_mm);
  auto predicted = collect(outcomes, &Outcome::predicted_mm);
  auto held = collect(outcomes, &Outcome::mean_error_mm);
  auto inside = collect(outcomes, &Outcome::inside);
  auto shares = collect(outcomes, &Outcome::inside_share);
  const auto sum = [](const std::vector<double> &values) {
    double total = 0.0;
    for (const double value : values) {
      total += value;
    }
    return total;
  };
  const auto count = static_cast<double>(seeds);
  report.add(bench::at_least("chain.runs_completed", static_cast<double>(errors.size()), "", count));
  report.add(bench::with_peer(bench::at_most("chain.error_at_target.median", bench::percentile(errors, 0.5), "mm", 0.8),
                              bench::percentile(predicted, 0.5), "predicted RMS"));
  report.add(bench::at_most("chain.error_at_target.worst", bench::percentile(errors, 1.0), "mm", 1.6));
  report.add(bench::at_least("chain.inside_predicted_95", sum(inside), "runs", 0.9 * count));
  report.add(bench::figure("chain.inside_predicted_95.all_frames", 100.0 * sum(shares) / count, "%"));
  report.add(bench::figure("chain.error_at_target.mean_of_hold.median", bench::percentile(held, 0.5), "mm"));
  return report.all_hold() ? 0 : 1;
}
