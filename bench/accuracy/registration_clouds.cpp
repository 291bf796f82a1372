// Figures of paired points, clouds, splines, and points with curves.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <random>
#include <sstream>

#include <Eigen/Geometry>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/intensity/similarity.hpp"
#include "algorithms/intensity/warp.hpp"
#include "algorithms/registration/cloud_pose.hpp"
#include "algorithms/registration/curves.hpp"
#include "algorithms/registration/gauss_kernel.hpp"
#include "algorithms/registration/gauss_sums.hpp"
#include "algorithms/registration/robust_points.hpp"
#include "algorithms/registration/spline_grid.hpp"
#include "algorithms/uncertainty/chi_square.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "bench/accuracy/registration_head.hpp"
#include "bench/accuracy/registration_parts.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/volume.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/algorithms/tables.hpp"

namespace bregma::bench {

namespace {

using namespace registration;
using geometry::Points2;
using geometry::Points3;

constexpr unsigned kCloudSeed = 20260315;
const std::filesystem::path kShared = "../shared/data";

template <class Task> double milliseconds(Task &&task) {
  const auto start = std::chrono::steady_clock::now();
  task();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

double degrees_between(const Eigen::Matrix3d &a, const Eigen::Matrix3d &b) {
  return Eigen::AngleAxisd(Eigen::Matrix3d(a.transpose() * b)).angle() / geometry::kRadiansPerDegree;
}

bool is_here(const Report &report, const std::filesystem::path &path) {
  const bool here = std::filesystem::exists(path);
  if (!here) {
    report.note(path.string() + " is not here: its figures are left out");
  }
  return here;
}

void paired_figures(Report &report, bool quick) {
  std::mt19937 rng(kCloudSeed);
  std::vector<double> ours;
  std::vector<double> plain;
  std::vector<double> robust;
  std::uint64_t allocations = 0;
  const int runs = quick ? 200 : 2000;
  for (std::vector<double> *times : {&ours, &plain, &robust}) {
    times->reserve(static_cast<std::size_t>(runs)); // what is counted are the fits' allocations
  }
  int right = 0;
  for (int run = 0; run < runs; ++run) {
    const auto T = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
    std::vector<PointPair> pairs;
    std::vector<Eigen::Vector3d> source;
    std::vector<Eigen::Vector3d> target;
    for (int i = 0; i < 8; ++i) {
      PointPair pair;
      pair.source_mm = test::normal_vector(rng, 60.0);
      pair.target_covariance = test::random_anisotropic(rng, 0.3, 0.9);
      pair.target_mm = T * pair.source_mm + test::draw(rng, pair.target_covariance);
      pairs.push_back(pair);
      source.push_back(pair.source_mm);
      target.push_back(pair.target_mm);
    }
    const test::AllocationScope scope;
    PairedFit fit;
    ours.push_back(1e3 * milliseconds([&] { fit = fit_paired(pairs); }));
    std::optional<PairedPose> rigid;
    plain.push_back(1e3 * milliseconds([&] { rigid = fit_rigid(source, target); }));
    pairs[3].target_mm += 10.0 * test::normal_vector(rng, 1.0).normalized();
    RobustFit with_outlier;
    robust.push_back(1e3 * milliseconds([&] { with_outlier = fit_paired_robust(pairs); }));
    allocations += scope.count();
    right += with_outlier.found && with_outlier.outliers == 1 && !with_outlier.inlier[3] ? 1 : 0;
  }
  report.add(beside(at_most("points.paired_8_anisotropic.median", percentile(ours, 0.5), "us", 20.0),
                    percentile(plain, 0.5), "least squares"));
  report.add(figure("points.robust_8_one_outlier.median", percentile(robust, 0.5), "us"));
  report.add(at_least("points.robust_outlier_named", 100.0 * right / runs, "%", 95.0));
  if (test::AllocationScope::available()) {
    report.add(at_most("points.allocations", static_cast<double>(allocations), "", 0.0));
  }
}

// Does the true error at a target 80 mm away lie in the predicted 95 % as often as that says?
void paired_coverage(Report &report, int runs) {
  for (const auto &[name, depth_mm] : {std::pair("isotropic", 0.3), std::pair("anisotropic", 0.9)}) {
    std::mt19937 rng(kCloudSeed);
    int inside = 0;
    for (int run = 0; run < runs; ++run) {
      const auto T = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
      std::vector<PointPair> pairs(8);
      for (PointPair &pair : pairs) {
        pair.source_mm = test::normal_vector(rng, 60.0);
        pair.target_covariance = test::random_anisotropic(rng, 0.3, depth_mm);
        pair.target_mm = T * pair.source_mm + test::draw(rng, pair.target_covariance);
      }
      const Eigen::Vector3d target = 80.0 * test::normal_vector(rng, 1.0).normalized();
      const PairedFit fit = fit_paired(pairs);
      const Eigen::Vector3d error = fit.T_target_source * target - T * target;
      const Matrix3d predicted = uncertainty::tre_covariance(fit.covariance, T * target);
      inside += uncertainty::mahalanobis_squared(predicted, error) <= uncertainty::kChiSquare95Of3 ? 1 : 0;
    }
    const std::string label = std::string("points.coverage.") + name;
    report.add(at_least(label, 100.0 * inside / runs, "%", 93.0));
    report.add(at_most(label + ".not_more", 100.0 * inside / runs, "%", 97.0));
  }
}

// The E-step as the formula has it, in doubles, one exponential a pair; the whole matrix is kept, as the paper does.
double naive_e_step_ms(const Points3 &x, const Points3 &y, double sigma, double c) {
  return milliseconds([&] {
    Eigen::MatrixXd P(y.cols(), x.cols());
    for (Eigen::Index n = 0; n < x.cols(); ++n) {
      for (Eigen::Index m = 0; m < y.cols(); ++m) {
        P(m, n) = std::exp(-(x.col(n) - y.col(m)).squaredNorm() / (2.0 * sigma * sigma));
      }
      P.col(n) /= P.col(n).sum() + c;
    }
    const Eigen::VectorXd weight = P.rowwise().sum();
    const Eigen::MatrixXd px = P * x.transpose();
    if (!(weight.sum() + px.sum() < 1e300)) {
      throw std::runtime_error("the naive E-step is not finite");
    }
  });
}

void cpd_figures(Report &report, const std::string &case_folder, bool quick) {
  const Head head = load_head(case_folder);
  std::mt19937 rng(kCloudSeed);
  report.note("CPD: vertices of the scalp, 20 % replaced by outliers, 30 degrees, noise 0.5 mm, two threads, sums by " +
              std::string(gauss_kernels().front().name) + "; seed " + std::to_string(kCloudSeed));
  for (const auto &[count, limit_ms] : {std::pair(1000, 150.0), std::pair(3000, 1000.0)}) {
    std::vector<double> times;
    std::vector<double> errors;
    std::vector<double> naive;
    for (int run = 0; run < (quick ? 3 : 20); ++run) {
      Points3 source(3, count);
      std::vector<Eigen::Vector3d> points;
      std::sample(head.mesh.vertices_mm.begin(), head.mesh.vertices_mm.end(), std::back_inserter(points), count, rng);
      for (Eigen::Index i = 0; i < count; ++i) {
        source.col(i) = points[static_cast<std::size_t>(i)];
      }
      const Eigen::Matrix3d R =
          Eigen::AngleAxisd(30.0 * geometry::kRadiansPerDegree, test::normal_vector(rng, 1.0).normalized())
              .toRotationMatrix();
      Points3 target = R * source;
      const Eigen::Vector3d middle = target.rowwise().mean();
      std::uniform_real_distribution<double> box(-120.0, 120.0);
      for (Eigen::Index i = 0; i < count; ++i) {
        target.col(i) = i % 5 == 0 ? Eigen::Vector3d(middle + Eigen::Vector3d(box(rng), box(rng), box(rng)))
                                   : Eigen::Vector3d(target.col(i) + test::normal_vector(rng, 0.5));
      }
      CpdOptions options;
      options.outlier_weight = 0.2;
      options.threads = 2;
      CpdResult<3> found;
      times.push_back(milliseconds([&] { found = register_cpd<3>(source, target, options); }));
      errors.push_back(found.has_estimate() ? degrees_between(found.rotation, R) : 180.0);
      if (run == 0) {
        naive.push_back(found.iterations * naive_e_step_ms(target / 100.0, source / 100.0, 0.3, 1.0));
      }
    }
    const std::string name = "cpd." + std::to_string(count);
    report.add(beside(at_most(name + ".median", percentile(times, 0.5), "ms", limit_ms), naive[0], "naive E-steps"));
    report.add(figure(name + ".rotation_error.worst", percentile(errors, 1.0), "deg"));
  }
}

void fixture_figures(Report &report) {
  const auto folder = kShared / "clouds/cpd";
  if (!is_here(report, folder)) {
    return;
  }
  const Points2 fish = test::read_points<2>(folder / "fish.csv");
  const Points2 distorted = test::read_points<2>(folder / "fish_distorted.csv");
  const auto expected = test::read_points<1>(folder / "fish_correspondence.csv");
  const auto found = correspondences<2>(distorted, fish, 1.0, paper_outlier_constant<2>(1.0, 0.1, 91, 91));
  int matched = 0;
  for (Eigen::Index m = 0; m < expected.cols(); ++m) {
    matched += found.of_source[static_cast<std::size_t>(m)].index == static_cast<int>(expected(0, m)) ? 1 : 0;
  }
  report.add(at_least("cpd.fish_correspondences_matched", matched, "of 91", 91.0));
}

Points3 read_counted(const std::filesystem::path &file) {
  std::ifstream in(file);
  Eigen::Index count = 0;
  in >> count;
  Points3 out(3, count);
  for (double &v : out.reshaped()) {
    in >> v;
  }
  return out;
}

void bunny_figures(Report &report) {
  const auto folder = kShared / "clouds/bunny";
  if (!is_here(report, folder)) {
    return;
  }
  const Points3 data = read_counted(folder / "data_bunny.txt");
  const Points3 model = read_counted(folder / "model_bunny.txt");
  std::ifstream in(folder / "output.txt");
  double their_seconds = 0.0;
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> theirs;
  in >> their_seconds;
  for (double &v : theirs.reshaped<Eigen::RowMajor>()) {
    in >> v;
  }
  // The model is whole and the data a part of it: the model is the source.
  std::vector<double> times;
  std::vector<double> errors;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    CloudPoseOptions options;
    options.threads = 2;
    options.seed = seed;
    CloudPose pose;
    times.push_back(1e-3 * milliseconds([&] { pose = find_cloud_pose(model, data, options); }));
    errors.push_back(degrees_between(pose.best.rotation.transpose(), theirs));
  }
  report.add(beside(at_most("bunny.time.median", percentile(times, 0.5), "s", 0.1 * their_seconds), their_seconds,
                    "Go-ICP, as published"));
  report.add(at_most("bunny.rotation_to_theirs.worst", percentile(errors, 1.0), "deg", 0.5));
}

Points3 bent(const Points3 &p) {
  Points3 out = p;
  for (Eigen::Index i = 0; i < p.cols(); ++i) {
    for (int d = 0; d < 3; ++d) {
      out(d, i) += 4.0 * std::sin(p((d + 1) % 3, i) / 35.0 + d) * std::cos(p(d, i) / 60.0);
    }
  }
  return out;
}

void spline_figures(Report &report, bool quick) {
  std::mt19937 rng(kCloudSeed);
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
      report.add(before > 0.0 ? beside(record, before, "fewer centres") : record);
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
        report.add(beside(at_least(label + ".grid_rate", std::isfinite(sum.sum()) ? rate : 0.0, "10^6/s", 1.0),
                          1e-3 * static_cast<double>(probes.cols()) / direct, "without the grid"));
        report.add(figure(label + ".grid_5mm.largest_error", grid->largest_error_mm(), "mm"));
        report.add(figure(label + ".grid_5mm.build", 1e-3 * built, "s"));
      }
    }
  }
  if (is_here(report, kShared / "distortion/repeat")) {
    const auto file = kShared / "distortion/repeat/Matched_Markers.csv";
    const Points3 distorted = test::read_points<3>(file, 1, 1);
    const Points3 truth = test::read_points<3>(file, 1, 5);
    SplineOptions options;
    options.leave_one_out = true;
    report.add(beside(figure("distortion.leave_one_out.r2lnr",
                             ThinPlateSpline<3>::fit(distorted, truth, options)->leave_one_out_mm().mean(), "mm"),
                      0.383, "published"));
    options.kernel = SplineKernel::kR;
    report.add(beside(figure("distortion.leave_one_out.r",
                             ThinPlateSpline<3>::fit(distorted, truth, options)->leave_one_out_mm().mean(), "mm"),
                      0.494, "published"));
  }
}

// A sagittal slice, grey values 0-255 of its 99.5th percentile; first axis anterior, second superior.
struct Slice {
  intensity::Grid<2> grid;
  std::vector<float> grey;
};
Slice middle_slice(const std::filesystem::path &file) {
  const auto volume = casefile::read_volume(file);
  if (!volume) {
    throw std::runtime_error(volume.error().message);
  }
  Slice out;
  out.grid.size = {volume->size[1], volume->size[2]};
  out.grid.axes = volume->T_image_index.block<2, 2>(1, 1);
  const int i = static_cast<int>(std::lround(-volume->T_image_index(0, 3) / volume->T_image_index(0, 0))); // x = 0
  out.grid.origin_mm = volume->T_image_index.block<2, 1>(1, 3);
  std::vector<double> sorted;
  for (int k = 0; k < volume->size[2]; ++k) {
    for (int j = 0; j < volume->size[1]; ++j) {
      out.grey.push_back(volume->at(i, j, k));
      sorted.push_back(static_cast<double>(volume->at(i, j, k)));
    }
  }
  const auto white = static_cast<float>(percentile(sorted, 0.995));
  for (float &v : out.grey) {
    v = std::clamp(v / white, 0.0F, 1.0F) * 255.0F;
  }
  return out;
}

struct Marks {
  Points2 landmarks, head;
};
Marks read_marks(const std::string &name) {
  const auto points = casefile::read_points("demo/curves/" + name + ".mrk.json");
  const auto curves = casefile::read_curves("demo/curves/" + name + ".csv");
  if (!points || !curves) {
    throw std::runtime_error(points ? curves.error().message : points.error().message);
  }
  Marks out{Points2(2, static_cast<Eigen::Index>(points->size())),
            Points2(2, static_cast<Eigen::Index>(curves->front().points_mm.size()))};
  for (Eigen::Index i = 0; i < out.landmarks.cols(); ++i) {
    out.landmarks.col(i) = (*points)[static_cast<std::size_t>(i)].position_mm.tail<2>();
  }
  for (Eigen::Index i = 0; i < out.head.cols(); ++i) {
    out.head.col(i) = curves->front().points_mm[static_cast<std::size_t>(i)].tail<2>();
  }
  return out;
}

// Table 3.1: before, points, curve, hybrid.
void table_of(Report &report, const std::string &title, const std::string &label, const Slice &reference,
              const Slice &floating, const Marks &on_reference, const Marks &on_floating) {
  CurvePair<2> head{on_reference.head, on_floating.head, 31, false};
  const PointSets<2> landmarks{on_reference.landmarks, on_floating.landmarks};
  const auto none = join<2>({Points2(2, 0), Points2(2, 0)}, std::span(&head, 1));
  const auto both = join<2>(landmarks, std::span(&head, 1));
  struct Warped {
    const char *name;
    double rmse, mi;
  };
  std::vector<Warped> rows;
  const auto add = [&](const char *name, const PointSets<2> *pairs) {
    std::vector<float> image;
    if (pairs == nullptr) {
      image = intensity::warp<2>(reference.grid, floating.grid, floating.grey, [](const auto &p) { return p; });
    } else {
      const auto spline = ThinPlateSpline<2>::fit(pairs->reference_mm, pairs->floating_mm);
      if (!spline) {
        throw std::runtime_error(title + ": " + spline.error());
      }
      image = intensity::warp<2>(reference.grid, floating.grid, floating.grey, *spline);
    }
    // What comes from outside the picture is background.
    std::replace_if(
        image.begin(), image.end(), [](float v) { return !std::isfinite(v); }, 0.0F);
    rows.push_back(
        {name, intensity::rmse(reference.grey, image), intensity::mutual_information(reference.grey, image)});
  };
  add("before", nullptr);
  add("point", &landmarks);
  add("curve", &*none);
  add("hybrid", &*both);
  std::ostringstream lines;
  lines << title << std::fixed << "\n  registration quality        before     point     curve    hybrid";
  lines << "\n  error parameter (RMSE)  " << std::setprecision(4);
  for (const Warped &row : rows) {
    lines << std::setw(10) << row.rmse;
  }
  lines << "\n  degree of matching (MI) ";
  for (const Warped &row : rows) {
    lines << std::setw(10) << row.mi;
  }
  report.note(lines.str());
  report.add(
      beside(at_most("curves." + label + ".rmse.hybrid", rows[3].rmse, "grey", std::min(rows[1].rmse, rows[2].rmse)),
             rows[0].rmse, "before"));
  report.add(beside(at_least("curves." + label + ".mi.hybrid", rows[3].mi, "nats", std::max(rows[1].mi, rows[2].mi)),
                    rows[0].mi, "before"));
}

// A smooth deformation of up to 9 mm from the reference's frame to the floating image's, and back.
Eigen::Vector2d deformed(const Eigen::Vector2d &p) {
  return p + Eigen::Vector2d(6.0 * std::sin(p.y() / 40.0) + 2.0, 5.0 * std::cos(p.x() / 45.0) - 0.03 * p.y());
}
Eigen::Vector2d undeformed(const Eigen::Vector2d &q) {
  Eigen::Vector2d p = q;
  for (int i = 0; i < 60; ++i) {
    p -= deformed(p) - q;
  }
  return p;
}

void curve_figures(Report &report) {
  if (!is_here(report, kShared / "images/mni")) {
    return;
  }
  const Slice one = middle_slice(kShared / "images/mni/single_subj_T1.nii.gz");
  const Slice average = middle_slice(kShared / "images/mni/avg152T1.nii.gz");
  const Marks on_one = read_marks("single_subj_T1");
  const Marks on_average = read_marks("avg152T1");
  table_of(report, "Inter-subject: the average of 152 heads (reference), one person (floating)", "inter_subject",
           average, one, on_average, on_one);
  Slice moved = one;
  moved.grey = intensity::warp<2>(one.grid, one.grid, one.grey, undeformed);
  std::replace_if(
      moved.grey.begin(), moved.grey.end(), [](float v) { return !std::isfinite(v); }, 0.0F);
  Marks on_moved = on_one;
  for (auto *points : {&on_moved.landmarks, &on_moved.head}) {
    for (Eigen::Index i = 0; i < points->cols(); ++i) {
      points->col(i) = deformed(points->col(i));
    }
  }
  table_of(report, "Intra-subject: one person (reference), the same deformed smoothly by up to 9 mm (floating)",
           "known_deformation", one, moved, on_one, on_moved);
}

} // namespace

void cloud_figures(Report &report, const RegistrationBenchOptions &options) {
  paired_figures(report, options.quick);
  paired_coverage(report, options.quick ? 200 : 2000);
  cpd_figures(report, options.case_folder, options.quick);
  fixture_figures(report);
  bunny_figures(report);
  spline_figures(report, options.quick);
  curve_figures(report);
}

} // namespace bregma::bench
