#include "algorithms/intensity/rigid_image.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "algorithms/intensity/pose_optimiser.hpp"
#include "algorithms/intensity/pose_starts.hpp"
#include "algorithms/intensity/resolution.hpp"
#include "algorithms/intensity/rigid_verdict.hpp"
#include "algorithms/intensity/size_check.hpp"

namespace bregma::intensity {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;
using geometry::Matrix6d;

constexpr double kCoarse_mm = 8.0;
constexpr double kMiddle_mm = 4.0;
constexpr std::size_t kCoarseSamples = 6'000;
constexpr std::size_t kMiddleSamples = 20'000;
constexpr int kCoarseBins = 32;
constexpr int kSearchRotations = 400; // about 29 degrees apart
constexpr std::size_t kRefinedAtCoarse = 16;
constexpr std::size_t kRefinedAtMiddle = 6;
constexpr std::size_t kRefinedAtFine = 2;
// On the scale from an unrelated pose to the best: a pose that is farther behind the best at 8 mm is not refined at 4
// mm, apart from the second best, which measures the lead; one behind by this lead at 4 mm is not refined at the finest
// level.
constexpr double kFarBehind = 0.4;
constexpr double kClearLead = 0.3;
constexpr double kSame_mm = 4.0;      // poses closer than this are one
constexpr double kReturned_mm = 2.0;  // a restart that ends closer than this came back
constexpr double kPerturbed_mm = 8.0; // of each restart, translation and rotation at kArm_mm
// Voxels and samples that count as one independent sample (docs/images.md: how they were measured).
constexpr double kVoxelsPerIndependent = 260.0;
constexpr double kSamplesPerIndependent = 14.4;

double unit_random(std::mt19937_64 &rng) { return static_cast<double>(rng() >> 11U) * 0x1.0p-52 - 1.0; }

struct Level {
  Volume reference, floating;
  std::unique_ptr<SimilarityMeasure> measure;
  double spacing_mm = 0.0;
};

class RigidSearch {
public:
  RigidSearch(const Volume &reference, const Volume &floating, const RigidImageOptions &options, parallel::Team &team)
      : options_(options), team_(team), fine_(level(reference, floating, options.finest_mm, options.max_samples)),
        middle_(level(fine_.reference, fine_.floating, kMiddle_mm, kMiddleSamples)),
        coarse_(level(middle_.reference, middle_.floating, kCoarse_mm, kCoarseSamples)),
        centre_mm_(centre_of_mass(coarse_.reference)), floating_centre_mm_(centre_of_mass(coarse_.floating)) {}

  RigidImageResult run();

private:
  struct Pose {
    Matrix4d T_floating_reference;
    double value;
  };

  Level level(const Volume &reference, const Volume &floating, double spacing_mm, std::size_t samples) const {
    return prepared({shrunk(reference, spacing_mm, team_), shrunk(floating, spacing_mm, team_), nullptr, spacing_mm},
                    samples);
  }
  Level prepared(Level out, std::size_t samples) const { return prepared(std::move(out), samples, options_.measure); }
  Level prepared(Level out, std::size_t samples, Measure measure) const {
    MeasureOptions of_measure = options_.measure_options;
    of_measure.max_samples = samples;
    of_measure.seed = options_.seed;
    if (out.spacing_mm > options_.finest_mm) {
      of_measure.bins = std::min(of_measure.bins, kCoarseBins);
    }
    out.measure = make_measure(measure, out.reference, out.floating, of_measure, team_);
    return out;
  }

  [[nodiscard]] bool proceed(double done, std::string_view stage) const {
    return !options_.progress || options_.progress(done, stage);
  }

  [[nodiscard]] Matrix4d centred(const Matrix3d &R) const; // with centres of mass aligned
  std::vector<Pose> starts();
  // What a pose without relation has at 4 mm, whatever the start poses are: the scale of a lead begins there.
  [[nodiscard]] double unrelated_value();
  Pose refine(Level &level, const Matrix4d &start, double first_step_mm, double tolerance_mm, int parameters = 6);
  // The best distinct ones.
  std::vector<Pose> distinct(std::vector<Pose> poses, std::size_t count) const;
  std::vector<Pose> refine_all(Level &level, const std::vector<Pose> &from, std::size_t count, double step_mm);
  [[nodiscard]] ReferenceFromFloating rigid(const Matrix4d &T_floating_reference) const;
  // The best value at 4 mm of the floating image's mirror image, from `best` with the sides exchanged.
  [[nodiscard]] double mirrored_value(const Pose &best);
  void check_capture(const Pose &best, RigidImageResult &out);
  // With another measure at 4 mm where the chosen one has no gradient.
  void check_size(const Pose &best, double unrelated, RigidImageResult &out);
  [[nodiscard]] double smaller_mm3() const; // volume of the smaller image
  void estimate_covariance(const Pose &best, RigidImageResult &out);

  const RigidImageOptions &options_;
  parallel::Team &team_;
  Level fine_, middle_, coarse_; // each made of the one before
  Vector3d centre_mm_, floating_centre_mm_;
  int evaluations_ = 0;
};

Matrix4d RigidSearch::centred(const Matrix3d &R) const {
  Matrix4d T = Matrix4d::Identity();
  T.topLeftCorner<3, 3>() = R;
  T.topRightCorner<3, 1>() = floating_centre_mm_ - R * centre_mm_;
  return T;
}

double RigidSearch::unrelated_value() {
  constexpr int kStride = 10;
  std::vector<double> values;
  for (int i = 0; i < kSearchRotations; i += kStride) {
    ++evaluations_;
    const double value = middle_.measure->value(centred(spread_rotation(i, kSearchRotations).toRotationMatrix()));
    if (std::isfinite(value)) {
      values.push_back(value);
    }
  }
  if (values.empty()) {
    return std::nan("");
  }
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<RigidSearch::Pose> RigidSearch::starts() {
  const Matrix4d given = options_.T_reference_floating.inverse().matrix();
  std::vector<Matrix4d> poses{given};
  if (options_.start != Start::kPose) {
    poses.push_back(centred(given.topLeftCorner<3, 3>()));
  }
  if (options_.start == Start::kSearch) {
    for (int i = 0; i < kSearchRotations; ++i) {
      poses.push_back(centred(spread_rotation(i, kSearchRotations).toRotationMatrix()));
    }
  }
  std::vector<Pose> out;
  for (const Matrix4d &T : poses) {
    ++evaluations_;
    const double value = coarse_.measure->value(T);
    if (std::isfinite(value)) {
      out.push_back({T, value});
    }
  }
  return out;
}

RigidSearch::Pose RigidSearch::refine(Level &level, const Matrix4d &start, double first_step_mm, double tolerance_mm,
                                      int parameters) {
  OptimiserOptions how;
  how.parameters = parameters;
  how.centre_mm = centre_mm_;
  how.first_step_mm = first_step_mm;
  how.tolerance_mm = tolerance_mm;
  const bool by_gradient = options_.optimiser == Optimiser::kGradient && level.measure->has_gradient();
  const Optimum found =
      by_gradient ? maximise_by_gradient(*level.measure, start, how) : maximise_by_lines(*level.measure, start, how);
  evaluations_ += found.evaluations;
  return {found.T_floating_reference, found.value};
}

std::vector<RigidSearch::Pose> RigidSearch::distinct(std::vector<Pose> poses, std::size_t count) const {
  std::stable_sort(poses.begin(), poses.end(), [](const Pose &a, const Pose &b) { return a.value > b.value; });
  std::vector<Pose> out;
  for (const Pose &pose : poses) {
    const bool known = std::any_of(out.begin(), out.end(), [&](const Pose &other) {
      return apart_mm(rigid(pose.T_floating_reference), rigid(other.T_floating_reference), centre_mm_) < kSame_mm;
    });
    if (!known && out.size() < count) {
      out.push_back(pose);
    }
  }
  return out;
}

std::vector<RigidSearch::Pose> RigidSearch::refine_all(Level &level, const std::vector<Pose> &from, std::size_t count,
                                                       double step_mm) {
  std::vector<Pose> out;
  for (const Pose &pose : from) {
    const Pose refined = refine(level, pose.T_floating_reference, step_mm, 0.1 * step_mm);
    if (std::isfinite(refined.value)) {
      out.push_back(refined);
    }
  }
  return distinct(std::move(out), count);
}

ReferenceFromFloating RigidSearch::rigid(const Matrix4d &T_floating_reference) const {
  const Matrix3d R = T_floating_reference.topLeftCorner<3, 3>();
  return ReferenceFromFloating(R, T_floating_reference.topRightCorner<3, 1>())
      .inverse()
      .as<geometry::frame::Target, geometry::frame::Source>();
}

// The mirror image is that of the voxels along the first axis. It lies where a reflection of the head (M) would have to
// be undone: T' = F T M, with F the reflection of the grid. M's plane is not known: one across each axis is tried.
double RigidSearch::mirrored_value(const Pose &best) {
  const auto mirrored = [](Volume image) {
    const int width = image.size[0];
    for (auto row = image.voxels.begin(); row != image.voxels.end(); row += width) {
      std::reverse(row, row + width);
    }
    return image;
  };
  Level coarse = prepared({coarse_.reference, mirrored(coarse_.floating), nullptr, kCoarse_mm}, kCoarseSamples);
  Level middle = prepared({middle_.reference, mirrored(middle_.floating), nullptr, kMiddle_mm}, kMiddleSamples);
  const auto reflection_of = [](const image::Grid<3> &grid) -> Matrix4d {
    Matrix4d flip = Matrix4d::Identity();
    flip(0, 0) = -1.0;
    flip(0, 3) = grid.size[0] - 1;
    return grid.T_image_index * flip * grid.T_image_index.inverse();
  };
  Pose found{Matrix4d::Identity(), std::nan("")};
  for (int axis = 0; axis < 3; ++axis) {
    Matrix4d M = Matrix4d::Identity();
    M(axis, axis) = -1.0;
    M(axis, 3) = 2.0 * centre_mm_[axis];
    const Pose pose =
        refine(coarse, reflection_of(coarse.floating) * best.T_floating_reference * M, kCoarse_mm, 0.1 * kCoarse_mm);
    if (std::isfinite(pose.value) && !(pose.value <= found.value)) {
      found = pose;
    }
  }
  if (!std::isfinite(found.value)) {
    return found.value;
  }
  const Matrix4d between_grids = reflection_of(middle.floating) * reflection_of(coarse.floating);
  return refine(middle, between_grids * found.T_floating_reference, kMiddle_mm, 0.1 * kMiddle_mm).value;
}

void RigidSearch::check_capture(const Pose &best, RigidImageResult &out) {
  std::mt19937_64 rng(options_.seed);
  const Pose at_middle = refine(middle_, best.T_floating_reference, 1.0, 0.05);
  const int needed = static_cast<int>(std::ceil(kMinReturned * options_.restarts));
  const int spare = options_.restarts - needed;
  // Until the verdict is decided: the rest could not change it.
  while (out.returned < needed && out.restarts - out.returned <= spare) {
    Step step(6);
    for (Eigen::Index k = 0; k < 6; ++k) {
      step[k] = unit_random(rng);
    }
    step.head<3>() *= kPerturbed_mm / step.head<3>().norm();
    step.tail<3>() *= kPerturbed_mm / step.tail<3>().norm();
    const Matrix4d start = at_middle.T_floating_reference * motion_of(step, centre_mm_);
    const Pose again = refine(middle_, start, kMiddle_mm, 0.1);
    const double apart = apart_mm(rigid(again.T_floating_reference), rigid(at_middle.T_floating_reference), centre_mm_);
    ++out.restarts;
    out.returned += std::isfinite(again.value) && apart < kReturned_mm ? 1 : 0;
  }
}

void RigidSearch::check_size(const Pose &best, double unrelated, RigidImageResult &out) {
  if (!middle_.measure->has_gradient()) {
    middle_ = prepared(std::move(middle_), kMiddleSamples, Measure::kNmi);
    unrelated = unrelated_value();
  }
  const SizeDifference found = size_difference(*middle_.measure, best.T_floating_reference, centre_mm_, kMiddle_mm);
  out.stretch = found.stretch;
  out.stretch_axis = found.axis;
  out.stretch_gain = found.rigid > unrelated ? found.gain / (found.rigid - unrelated) : 0.0;
}

double RigidSearch::smaller_mm3() const {
  const auto volume = [](const Volume &image) { // where it has values
    const auto known =
        std::count_if(image.voxels.begin(), image.voxels.end(), [](float v) { return std::isfinite(v); });
    return static_cast<double>(known) * std::abs(image.axes().determinant());
  };
  return std::min(volume(fine_.floating), volume(fine_.reference));
}

void RigidSearch::estimate_covariance(const Pose &best, RigidImageResult &out) {
  // Samples times their mutual information is the logarithm of the likelihood ratio of "related as here" to
  // "unrelated", so its curvature is the information on the pose. The step spans the interpolation's ripples.
  constexpr double kStep_mm = 1.5;
  MeasureOptions of_information;
  of_information.bins = kCoarseBins;
  of_information.tail = options_.measure_options.tail;
  of_information.max_samples = options_.max_samples;
  of_information.seed = options_.seed;
  const auto information = make_measure(Measure::kMi, fine_.reference, fine_.floating, of_information, team_);
  const auto gradient = [&](const Step &step) {
    const Matrix4d T = best.T_floating_reference * motion_of(step, centre_mm_);
    AffineGradient by_affine;
    (void)information->value_and_gradient(T, by_affine);
    ++evaluations_;
    return step_gradient(by_affine, T, centre_mm_, 6);
  };
  out.mutual_information = information->value(best.T_floating_reference);
  Matrix6d curvature;
  for (Eigen::Index i = 0; i < 6; ++i) {
    Step step = Step::Zero(6);
    step[i] = kStep_mm;
    curvature.col(i) = (gradient(-step) - gradient(step)) / (2.0 * kStep_mm);
  }
  curvature = (0.5 * (curvature + curvature.transpose())).eval();
  // Neighbouring voxels are not independent, nor are noise and interpolation part of that likelihood.
  const auto voxel = [](const image::Grid<3> &grid) { return std::abs(grid.axes().determinant()); };
  const double overlap_mm3 = out.overlap * smaller_mm3();
  const double voxels = overlap_mm3 / std::max(voxel(fine_.reference), voxel(fine_.floating));
  const auto known = std::count_if(fine_.reference.voxels.begin(), fine_.reference.voxels.end(),
                                   [](float v) { return std::isfinite(v); });
  const double samples = static_cast<double>(fine_.measure->samples()) * overlap_mm3 /
                         (static_cast<double>(known) * voxel(fine_.reference));
  const double independent = std::min(voxels / kVoxelsPerIndependent, samples / kSamplesPerIndependent);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(curvature * independent);
  Matrix6d C = Matrix6d::Zero();
  constexpr double kFlat = 1e-4; // per mm squared: a direction that is free within 100 mm
  for (Eigen::Index i = 0; i < 6; ++i) {
    const auto axis = solver.eigenvectors().col(i);
    C += axis * axis.transpose() / std::max(solver.eigenvalues()[i], kFlat);
  }
  // From motions in mm about the centre to a twist about the origin.
  Matrix6d J = Matrix6d::Identity();
  J.topLeftCorner<3, 3>() /= kArm_mm;
  J.bottomLeftCorner<3, 3>() = geometry::skew(centre_mm_) / kArm_mm;
  out.covariance = J * C * J.transpose();
}

RigidImageResult RigidSearch::run() {
  RigidImageResult out;
  const auto stopped = [&] {
    out.reason = "stopped";
    return out;
  };
  if (!proceed(0.1, "comparing start poses")) {
    return stopped();
  }
  const std::vector<Pose> first = starts();
  if (first.empty()) {
    out.reason = "the images do not overlap where their headers place them";
    return out;
  }
  std::vector<double> values;
  for (const Pose &pose : first) {
    values.push_back(pose.value);
  }
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  if (!proceed(0.3, "refining at 8 mm")) {
    return stopped();
  }
  std::vector<Pose> poses = refine_all(coarse_, distinct(first, kRefinedAtCoarse), kRefinedAtMiddle, kCoarse_mm);
  if (!proceed(0.5, "refining at 4 mm")) {
    return stopped();
  }
  if (poses.size() > 2) {
    const double limit = poses[0].value - kFarBehind * (poses[0].value - values[values.size() / 2]);
    const auto far = std::find_if(poses.begin() + 2, poses.end(), [&](const Pose &pose) { return pose.value < limit; });
    poses.erase(far, poses.end()); // they are sorted
  }
  poses = refine_all(middle_, poses, kRefinedAtMiddle, kMiddle_mm);
  if (poses.empty()) {
    out.reason = "the images do not overlap";
    return out;
  }
  for (const Pose &pose : poses) {
    out.candidates.push_back({rigid(pose.T_floating_reference), pose.value});
  }
  const double unrelated = unrelated_value();
  const double mirrored = mirrored_value(poses.front());
  const double scale = poses[0].value - unrelated;
  if (scale > 0.0) { // otherwise the best explains no more than any other: no lead
    out.mirror_lead = std::isfinite(mirrored) ? (poses[0].value - mirrored) / scale : 1.0;
    out.lead = poses.size() < 2 ? 1.0 : std::min((poses[0].value - poses[1].value) / scale, 1.0);
  }
  if (!proceed(0.6, "refining at the finest level")) {
    return stopped();
  }
  poses.resize(std::min(poses.size(), out.lead > kClearLead ? std::size_t{1} : kRefinedAtFine));
  std::vector<Pose> finest;
  for (const Pose &pose : poses) {
    finest.push_back(refine(fine_, pose.T_floating_reference, options_.finest_mm, 0.01));
  }
  finest = distinct(finest, kRefinedAtFine);
  Pose best = finest.front();
  out.T_reference_floating = rigid(best.T_floating_reference);
  if (apart_mm(out.T_reference_floating, out.candidates.front().T_reference_floating, centre_mm_) > kSame_mm) {
    out.lead = 0.0; // the levels disagree on which pose is the best
  }
  out.similarity = fine_.measure->value(best.T_floating_reference);
  out.overlap = fine_.measure->overlap();
  if (!proceed(0.8, "checking the capture")) {
    return stopped();
  }
  check_capture(best, out);
  if (!options_.affine) {
    check_size(best, unrelated, out);
  }
  estimate_covariance(best, out);
  out.affine = out.T_reference_floating.matrix();
  if (options_.affine) {
    const Pose affine = refine(fine_, best.T_floating_reference, options_.finest_mm, 0.01, 12);
    out.affine = affine.T_floating_reference.inverse();
    out.similarity = affine.value;
  }
  judge(out, centre_mm_, options_);
  out.evaluations = evaluations_;
  return out;
}

} // namespace

std::string_view name_of(ImageVerdict verdict) {
  return verdict == ImageVerdict::kFound ? "found" : verdict == ImageVerdict::kAmbiguous ? "ambiguous" : "refused";
}

double apart_mm(const ReferenceFromFloating &a, const ReferenceFromFloating &b, const Vector3d &centre_mm) {
  // Mean over a sphere of |(R - I) r|^2: |R - I|^2 r^2 / 3.
  const auto difference = a * b.inverse();
  const Matrix3d turn = difference.rotation_matrix() - Matrix3d::Identity();
  const double shift2 = (difference * centre_mm - centre_mm).squaredNorm();
  return std::sqrt(shift2 + turn.squaredNorm() * kArm_mm * kArm_mm / 3.0);
}

RigidImageResult register_rigid(const Volume &reference, const Volume &floating, const RigidImageOptions &options,
                                parallel::Team &team) {
  RigidImageResult out;
  out.reason = obstacle(reference, "reference");
  if (out.reason.empty()) {
    out.reason = obstacle(floating, "floating");
  }
  if (!out.reason.empty()) {
    return out;
  }
  if (options.progress && !options.progress(0.0, "preparing levels")) {
    out.reason = "stopped";
    return out;
  }
  return RigidSearch(reference, floating, options, team).run();
}

} // namespace bregma::intensity
