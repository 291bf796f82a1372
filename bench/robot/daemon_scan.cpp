// Registration of an arm to the image by the daemon's own stages: the simulated arm behind a socket and the simulated
// range sensor on a pseudo-terminal, their drivers, and a scan of the face in virtual time: docs/robot_navigation.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <future>
#include <string>
#include <vector>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "bench/robot/robot_parts.hpp"
#include "idl/names.hpp"
#include "tests/component/robot/robot_operator.hpp"
#include "tests/component/robot/robot_room.hpp"

namespace bregma::bench {

namespace {

using geometry::frame::Image;
using geometry::frame::Reference;

struct DaemonScan {
  std::uint32_t points = 0;
  bool found = false, inside = false;                       // the predicted 95 % region
  geometry::Vector3d error_mm = geometry::Vector3d::Zero(); // at the case's target, in Image
  double predicted_rms_mm = 0.0, bound_mm = 0.0;
  std::string text; // of the registration
};

DaemonScan scan_once(std::uint64_t seed, test::RangeKnowledge known) {
  const test::RobotCase a_case(seed, false, true, known);
  test::RobotRoom room(a_case, seed);
  test::RobotOperator person(a_case, room);
  person.begin();
  person.scan(8.0, 50.0);
  DaemonScan out;
  out.points = room.registration.surface_count;
  out.text = room.registration.text;
  out.found = room.registration.status == bregma_wire_REGISTRATION_CANDIDATE;
  if (!out.found) {
    return out;
  }
  const auto T = wire::from_wire<Image, Reference>(room.registration.T_image_reference);
  const geometry::Vector3d target = a_case.loaded().targets.front().position_mm;
  out.error_mm = T * (room.T_base_image() * target) - target;
  const geometry::Matrix3d predicted = uncertainty::tre_covariance(
      Eigen::Matrix<double, 6, 6, Eigen::RowMajor>::Map(room.registration.covariance), target);
  out.predicted_rms_mm = uncertainty::rms_mm(predicted);
  out.bound_mm = uncertainty::ellipsoid_95(predicted).semi_axes_mm[0];
  out.inside =
      uncertainty::mahalanobis_squared(predicted, out.error_mm) <= uncertainty::chi_square_upper_quantile(0.05, 3);
  return out;
}

// Of the scans that found a pose.
struct Summary {
  int found = 0, inside = 0;
  double mean_mm = 0.0, rms_mm = 0.0, worst_mm = 0.0, predicted_rms_mm = 0.0;
};

Summary summary_of(const std::vector<DaemonScan> &scans) {
  Summary out;
  for (const DaemonScan &scan : scans) {
    if (scan.found) {
      ++out.found;
      out.inside += scan.inside ? 1 : 0;
      out.mean_mm += scan.error_mm.norm();
      out.rms_mm += scan.error_mm.squaredNorm();
      out.predicted_rms_mm += std::pow(scan.predicted_rms_mm, 2);
      out.worst_mm = std::max(out.worst_mm, scan.error_mm.norm());
    }
  }
  out.mean_mm /= out.found;
  out.rms_mm = std::sqrt(out.rms_mm / out.found);
  out.predicted_rms_mm = std::sqrt(out.predicted_rms_mm / out.found);
  return out;
}

template <class... Values> std::string line(const char *pattern, Values... values) {
  std::array<char, 400> out{};
  std::snprintf(out.data(), out.size(), pattern, values...);
  return out.data();
}

} // namespace

void daemon_scan_figures(Report &report, const RobotBenchOptions &options) {
  struct Variant {
    const char *name, *text;
    test::RangeKnowledge known;
  };
  const std::array<Variant, 3> variants{{
      {"law", "power law alone, tilted skin as it is read", {false, 0.0}},
      {"corrected", "corrected curve, tilted skin as it is read", {true, 0.0}},
      {"excess", "corrected curve and excess estimated: what the daemon does", {true, 5.0}},
  }};
  const std::uint64_t seeds = options.quick ? 2 : 20;
  report.note(line("face scans by the daemon's stages: 96 x 112 mm at 50 mm/s, lines 8 mm apart, seeds 1 to %d",
                   static_cast<int>(seeds)));
  for (const Variant &variant : variants) {
    std::vector<std::future<DaemonScan>> runs; // they wait for their devices' bytes, and seldom for a core
    for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
      runs.push_back(std::async(std::launch::async, scan_once, seed, variant.known));
    }
    report.note(variant.text);
    std::vector<DaemonScan> scans;
    for (auto &run : runs) {
      const DaemonScan &scan = scans.emplace_back(run.get());
      report.note(line("  seed %2zu: %u points, error %.2f mm (%5.2f %5.2f %5.2f), predicted %.2f mm RMS, 95 %% within "
                       "%.2f mm%s %s",
                       scans.size(), scan.points, scan.error_mm.norm(), scan.error_mm.x(), scan.error_mm.y(),
                       scan.error_mm.z(), scan.predicted_rms_mm, scan.bound_mm, scan.inside ? "" : ": OUTSIDE",
                       scan.text.c_str()));
    }
    const Summary all = summary_of(scans);
    report.note(line("  found %d of %d; error: mean %.2f, RMS %.2f, worst %.2f mm; predicted %.2f mm RMS; inside the "
                     "predicted 95 %%: %d",
                     all.found, static_cast<int>(seeds), all.mean_mm, all.rms_mm, all.worst_mm, all.predicted_rms_mm,
                     all.inside));
    const std::string name = std::string("robot.daemon.") + variant.name;
    report.add(figure(name + ".tre.mean", all.mean_mm, "mm"));
    report.add(figure(name + ".tre.worst", all.worst_mm, "mm"));
    report.add(figure(name + ".found", 100.0 * all.found / static_cast<double>(seeds), "%"));
    report.add(figure(name + ".inside_95", 100.0 * all.inside / all.found, "%"));
  }
}

} // namespace bregma::bench
