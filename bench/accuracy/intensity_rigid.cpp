// Registration in space: success, time, and whether the predicted covariance holds.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <tuple>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "algorithms/geometry/angles.hpp"
#include "bench/accuracy/intensity_elastix.hpp"
#include "bench/accuracy/intensity_parts.hpp"

namespace bregma::bench {

namespace {

using Eigen::Vector3d;
using intensity::ImageVerdict;
using intensity::Measure;
using intensity::ReferenceFromFloating;
using intensity::RigidImageOptions;
using intensity::RigidImageResult;
using intensity::Volume;

const Vector3d kBrainCentre(0.0, -20.0, 10.0); // MNI, mm
constexpr double kHalfVoxel_mm = 1.0;
constexpr double kHalfDegree = 0.5;

RigidImageOptions usual() {
  RigidImageOptions out;
  out.measure_options.tail = 0.001;
  return out;
}

double since_s(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

// The image with a header that is wrong by a motion; the registration has to find its inverse.
struct Misplaced {
  Volume image;
  ReferenceFromFloating truth;
};
Misplaced misplaced(const Volume &image, bool anywhere, std::mt19937_64 &rng) {
  constexpr double kNearDegrees = 30.0;
  Eigen::Quaterniond turn(
      Eigen::AngleAxisd(std::abs(uniform(rng)) * kNearDegrees * geometry::kRadiansPerDegree, direction(rng)));
  if (anywhere) {
    turn = Eigen::Quaterniond(normal(rng), normal(rng), normal(rng), normal(rng)).normalized();
  }
  const Vector3d shift = (anywhere ? 100.0 : 30.0) * std::abs(uniform(rng)) * direction(rng);
  const geometry::Rigid3<geometry::frame::Source, geometry::frame::Target> moved(turn, shift);
  Misplaced out{image, moved.inverse()};
  out.image.T_image_index = moved.matrix() * image.T_image_index;
  return out;
}

struct Tally {
  int runs = 0, right = 0, found = 0, wrong_found = 0;
  std::vector<double> errors_mm, times_s;

  void take(const RigidImageResult &result, const ReferenceFromFloating &truth, double time_s) {
    ++runs;
    times_s.push_back(time_s);
    const double shift = (result.T_reference_floating * (truth.inverse() * kBrainCentre) - kBrainCentre).norm();
    const double turn = geometry::angle_between(result.T_reference_floating.rotation(), truth.rotation());
    right += shift <= kHalfVoxel_mm && turn <= kHalfDegree * geometry::kRadiansPerDegree ? 1 : 0;
    errors_mm.push_back(intensity::apart_mm(result.T_reference_floating, truth, kBrainCentre));
    const bool is_found = result.verdict == ImageVerdict::kFound;
    found += is_found ? 1 : 0;
    wrong_found += is_found && worst_corner_mm(result, truth) > 4.0 ? 1 : 0; // two voxels
  }

private:
  // Largest error over the corners of the brain's box.
  static double worst_corner_mm(const RigidImageResult &result, const ReferenceFromFloating &truth) {
    double worst = 0.0;
    for (unsigned corner = 0; corner < 8; ++corner) {
      const Vector3d p = kBrainCentre + Vector3d((corner & 1U) != 0 ? 70 : -70, (corner & 2U) != 0 ? 85 : -85,
                                                 (corner & 4U) != 0 ? 65 : -65);
      worst = std::max(worst, (result.T_reference_floating * (truth.inverse() * p) - p).norm());
    }
    return worst;
  }
};

Tally success(const Volume &reference, const Volume &floating, const RigidImageOptions &how, bool anywhere, int starts,
              unsigned seed, const std::string &study) {
  std::mt19937_64 rng(seed);
  parallel::Team team(bench_threads());
  Progress progress(study, starts);
  Tally out;
  for (int i = 0; i < starts; ++i) {
    const Misplaced pair = misplaced(floating, anywhere, rng);
    const auto began = std::chrono::steady_clock::now();
    const RigidImageResult result = intensity::register_rigid(reference, pair.image, how, team);
    out.take(result, pair.truth, since_s(began));
    progress.step();
  }
  return out;
}

double percent(int part, int whole) { return 100.0 * part / whole; }

} // namespace

void rigid_figures(Report &report, const IntensityOptions &options) {
  const Volume t1 = load_volume(options.mni + "/avg152T1.nii.gz");
  const int starts = options.quick ? 4 : 100;
  report.note("Templates at 2 mm onto T1, the header wrong by up to 30 mm and 30 deg, " + std::to_string(starts) +
              " starts; any pose: by any rotation and up to 100 mm; right: within half a voxel and 0.5 deg; wrong: "
              "found, and more than two voxels off at the worst "
              "corner of the brain. CT and T1 are means of two populations");
  for (const auto &[file, name, limited] :
       {std::tuple("/avg152T2.nii.gz", "T2/T1", true), std::tuple("/avg152PD.nii.gz", "PD/T1", true),
        std::tuple("/scct.nii.gz", "CT/T1", false)}) {
    const Volume floating = load_volume(options.mni + file);
    Tally tally = success(t1, floating, usual(), false, starts, 41, name);
    const std::string label(name);
    const double right = percent(tally.right, tally.runs);
    report.add(limited ? at_least(label + " right", right, "%", 99.0) : figure(label + " right", right, "%"));
    report.add(figure(label + " rms distance, median", percentile(tally.errors_mm, 0.5), "mm"));
    report.add(figure(label + " rms distance, worst", percentile(tally.errors_mm, 1.0), "mm"));
    report.add(at_most(label + " found but wrong", tally.wrong_found, "runs", 0.0));
    report.add(figure(label + " time, median", percentile(tally.times_s, 0.5), "s"));
    const Tally any = success(t1, floating, usual(), true, starts, 43, label + " from any pose");
    const double any_right = percent(any.right, any.runs);
    report.add(limited ? at_least(label + " from any pose right", any_right, "%", 95.0)
                       : figure(label + " from any pose right", any_right, "%"));
    report.add(figure(label + " from any pose found", percent(any.found, any.runs), "%"));
    report.add(at_most(label + " from any pose found but wrong", any.wrong_found, "runs", 0.0));
  }
  const Volume t2 = load_volume(options.mni + "/avg152T2.nii.gz");
  for (const bool lines : {false, true}) {
    RigidImageOptions how = usual();
    how.start = intensity::Start::kCentres;
    how.optimiser = lines ? intensity::Optimiser::kLines : intensity::Optimiser::kGradient;
    const std::string label = lines ? "Powell" : "BFGS";
    Tally tally = success(t1, t2, how, false, options.quick ? 3 : 20, 53, label);
    report.add(figure("T2/T1 " + label + " right", percent(tally.right, tally.runs), "%"));
    report.add(figure("T2/T1 " + label + " time, median", percentile(tally.times_s, 0.5), "s"));
  }
}

void measure_figures(Report &report, const IntensityOptions &options) {
  const Volume t1 = load_volume(options.mni + "/avg152T1.nii.gz");
  report.note("Success of each measure: templates onto T1 from centres of mass, the header wrong by up to 30 mm and 30 "
              "deg. Measures with a derivative in closed form: 100 starts; others, by Powell's method on all voxels of "
              "4 mm: 10 starts. --quick: T2/T1 and the former alone, one start");
  for (const auto &[file, pair] : {std::pair("/avg152T2.nii.gz", "T2/T1 "), std::pair("/avg152PD.nii.gz", "PD/T1 "),
                                   std::pair("/scct.nii.gz", "CT/T1 ")}) {
    const Volume floating = load_volume(options.mni + file);
    for (const intensity::MeasureName &measure : intensity::kMeasures) {
      RigidImageOptions how = usual();
      how.measure = measure.measure;
      how.start = intensity::Start::kCentres;
      parallel::Team team(bench_threads());
      const bool quick_to_compare =
          intensity::make_measure(measure.measure, t1, floating, how.measure_options, team)->has_gradient();
      if (options.quick && !quick_to_compare) {
        continue; // minutes
      }
      how.finest_mm = quick_to_compare ? how.finest_mm : 4.0;
      const int starts = options.quick ? 1 : quick_to_compare ? 100 : 10;
      const std::string label = pair + std::string(measure.name) + " from centres";
      Tally tally = success(t1, floating, how, false, starts, 47, label);
      report.add(figure(label + " right", percent(tally.right, tally.runs), "%"));
      report.add(figure(label + " found", percent(tally.found, tally.runs), "%"));
      report.add(figure(label + " found but wrong", tally.wrong_found, "runs"));
      report.add(figure(label + " rms distance, median", percentile(tally.errors_mm, 0.5), "mm"));
      report.add(figure(label + " time, median", percentile(tally.times_s, 0.5), "s"));
    }
    if (options.quick) {
      break;
    }
  }
}

void one_mm_figures(Report &report, const IntensityOptions &options) {
  const Volume head = load_volume(options.colin);
  parallel::Team team(bench_threads());
  const int runs = options.quick ? 1 : 10;
  report.note("Colin27 at 1 mm (181 x 217 x 181) with its copy: grey-value map, bias field, 2 to 9 % noise, pose up to "
              "30 deg and 20 mm, part of the field of view");
  std::mt19937_64 rng(61);
  SyntheticOptions how;
  how.spacing_mm = 1.0;
  std::vector<double> errors;
  std::vector<double> times;
  for (int i = 0; i < runs; ++i) {
    const SyntheticPair pair = synthetic_pair(head, how, rng, team);
    const auto began = std::chrono::steady_clock::now();
    const RigidImageResult result = intensity::register_rigid(pair.reference, pair.floating, usual(), team);
    times.push_back(since_s(began));
    errors.push_back(intensity::apart_mm(result.T_reference_floating, pair.truth, kBrainCentre));
  }
  report.add(at_most("1 mm pair time, worst", percentile(times, 1.0), "s", 5.0));
  report.add(figure("1 mm pair rms distance, worst", percentile(errors, 1.0), "mm"));
}

void speed_figures(Report &report, const IntensityOptions &options) {
  const Volume t1 = load_volume(options.mni + "/avg152T1.nii.gz");
  std::mt19937_64 rng(67);
  const Misplaced pair = misplaced(load_volume(options.mni + "/avg152T2.nii.gz"), false, rng);
  parallel::Team team(bench_threads());
  report.note(
      "Each program on two threads, in turns; medians. Both start from centres (of mass; elastix: of geometry)");
  const auto ours = [&](intensity::Start start, std::vector<double> &times) {
    RigidImageOptions how = usual();
    how.start = start;
    const auto began = std::chrono::steady_clock::now();
    const RigidImageResult result = intensity::register_rigid(t1, pair.image, how, team);
    times.push_back(since_s(began));
    return intensity::apart_mm(result.T_reference_floating, pair.truth, kBrainCentre);
  };
  std::vector<double> centres_s;
  std::vector<double> search_s;
  std::vector<double> peer_s;
  double centres_mm = 0.0;
  double search_mm = 0.0;
  double peer_mm = 0.0;
  for (int i = 0; i < (options.quick ? 3 : 9); ++i) {
    centres_mm = ours(intensity::Start::kCentres, centres_s);
    search_mm = ours(intensity::Start::kSearch, search_s);
    const auto peer = run_elastix(t1, pair.image);
    if (!peer) {
      report.note("elastix: " + peer.error().message);
      continue;
    }
    peer_s.push_back(peer->time_s);
    peer_mm = intensity::apart_mm(peer->T_reference_floating, pair.truth, kBrainCentre);
  }
  report.add(figure("T2/T1 from centres of mass, rms distance", centres_mm, "mm"));
  report.add(figure("T2/T1 from centres of mass, time", percentile(centres_s, 0.5), "s"));
  report.add(figure("T2/T1 from all rotations, rms distance", search_mm, "mm"));
  report.add(figure("T2/T1 from all rotations, time", percentile(search_s, 0.5), "s"));
  if (!peer_s.empty()) {
    report.add(figure("elastix, rms distance", peer_mm, "mm"));
    report.add(figure("elastix, time without files", percentile(peer_s, 0.5), "s"));
    report.add(at_least("elastix, time over ours from centres", percentile(peer_s, 0.5) / percentile(centres_s, 0.5),
                        "times", 5.0));
    report.add(at_least("elastix, time over ours from all rotations",
                        percentile(peer_s, 0.5) / percentile(search_s, 0.5), "times", 5.0));
  }
}

namespace {

// Registers synthetic pairs of a head, and counts points on a 60 mm sphere within their 95 % region.
void synthetic_pairs(Report &report, const IntensityOptions &options, const std::string &name, int runs,
                     const SyntheticOptions &pairs, intensity::Start start) {
  const Volume head = load_volume(options.colin);
  parallel::Team team(bench_threads());
  std::mt19937_64 rng(71);
  Progress progress(name, runs);
  int inside = 0;
  int points = 0;
  int found = 0;
  int wrong = 0;
  double squares = 0.0;
  double predicted = 0.0;
  for (int i = 0; i < runs; ++i) {
    const SyntheticPair pair = synthetic_pair(head, pairs, rng, team);
    RigidImageOptions how = usual();
    how.start = start;
    how.seed = static_cast<std::uint64_t>(i) + 1;
    const RigidImageResult result = intensity::register_rigid(pair.reference, pair.floating, how, team);
    progress.step();
    if (result.verdict != ImageVerdict::kFound) {
      continue;
    }
    ++found;
    double worst = 0.0;
    for (unsigned corner = 0; corner < 8; ++corner) {
      const Vector3d p = kBrainCentre + 60.0 / std::sqrt(3.0) *
                                            Vector3d((corner & 1U) != 0 ? 1 : -1, (corner & 2U) != 0 ? 1 : -1,
                                                     (corner & 4U) != 0 ? 1 : -1);
      const Vector3d error = result.T_reference_floating * (pair.truth.inverse() * p) - p;
      const geometry::Matrix36d J = geometry::point_jacobian(p);
      const Eigen::Matrix3d C = J * result.covariance * J.transpose();
      constexpr double kChi95 = 7.8147; // three degrees of freedom
      inside += error.dot(C.ldlt().solve(error)) <= kChi95 ? 1 : 0;
      squares += error.squaredNorm();
      predicted += C.trace();
      worst = std::max(worst, error.norm());
      ++points;
    }
    wrong += worst > 2.0 * pairs.spacing_mm ? 1 : 0;
  }
  report.add(figure(name + ": pairs found", percent(found, runs), "%"));
  report.add(at_most(name + ": found but wrong by two voxels", wrong, "runs", 0.0));
  report.add(figure(name + ": points inside their 95 % region", percent(inside, std::max(points, 1)), "%"));
  report.add(with_peer(figure(name + ": predicted rms", std::sqrt(predicted / points), "mm"),
                       std::sqrt(squares / points), "true"));
}

} // namespace

void coverage_figures(Report &report, const IntensityOptions &options) {
  report.note(
      "Predicted covariance, synthetic pairs of Colin27 at 2 mm (map, bias field, 2 to 9 % noise, 60 to 100 % of "
      "the field of view, pose up to 30 deg and 20 mm): points on a 60 mm sphere within their 95 % region. "
      "Its two constants were measured with other seeds (docs/images.md)");
  synthetic_pairs(report, options, "covariance", options.quick ? 8 : 1000, {}, intensity::Start::kCentres);
}

void search_figures(Report &report, const IntensityOptions &options) {
  SyntheticOptions pairs;
  pairs.rotation_deg = 180.0;
  pairs.translation_mm = 80.0;
  report.note("Search over all rotations: the pairs of the coverage, turned by up to 180 deg and moved by up to 80 mm");
  synthetic_pairs(report, options, "search", options.quick ? 4 : 200, pairs, intensity::Start::kSearch);
}

} // namespace bregma::bench
