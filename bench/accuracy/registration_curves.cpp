// Figures of points with curves, in the layout of [thesis, table 3.1].
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "algorithms/intensity/similarity.hpp"
#include "algorithms/intensity/warp.hpp"
#include "algorithms/registration/splines/curves.hpp"
#include "algorithms/registration/splines/thin_plate_spline.hpp"
#include "bench/accuracy/registration_parts.hpp"
#include "bench/accuracy/registration_study.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::bench {

namespace {

using namespace registration;
using geometry::Points2;

// A sagittal slice, grey values 0-255 of its 99.5th percentile; first axis anterior, second superior.
struct Slice {
  image::Grid<2> grid;
  std::vector<float> grey;
};
Slice middle_slice(const std::filesystem::path &file) {
  const auto volume = casefile::read_volume(file);
  if (!volume) {
    throw std::runtime_error(volume.error().message);
  }
  Slice out;
  out.grid.size = {volume->size[1], volume->size[2]};
  out.grid.T_image_index.topLeftCorner<2, 2>() = volume->T_image_index.block<2, 2>(1, 1);
  const int i = static_cast<int>(std::lround(-volume->T_image_index(0, 3) / volume->T_image_index(0, 0))); // x = 0
  out.grid.T_image_index.topRightCorner<2, 1>() = volume->T_image_index.block<2, 1>(1, 3);
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

// [thesis, table 3.1]: before, points, curves, hybrid.
void table_of(Report &report, const std::string &title, const std::string &label, const Slice &reference,
              const Slice &floating, const Marks &on_reference, const Marks &on_floating) {
  CurvePair<2> head{on_reference.head, on_floating.head, 31, false};
  const PointSets<2> landmarks{on_reference.landmarks, on_floating.landmarks};
  const auto none = join<2>({Points2(2, 0), Points2(2, 0)}, std::span(&head, 1));
  const auto both = join<2>(landmarks, std::span(&head, 1));
  const auto warped = [&](const PointSets<2> &pairs) {
    const auto spline = ThinPlateSpline<2>::fit(pairs.reference_mm, pairs.floating_mm);
    if (!spline) {
      throw std::runtime_error(title + ": " + spline.error());
    }
    return intensity::warp<2>(reference.grid, floating.grid, floating.grey, *spline);
  };
  auto before = intensity::warp<2>(reference.grid, floating.grid, floating.grey, [](const auto &p) { return p; });
  auto point = warped(landmarks);
  auto curve = warped(*none);
  auto hybrid = warped(*both);
  intensity::restrict_to_overlap({&before, &point, &curve, &hybrid});
  struct Similarity {
    double rmse, mi;
  };
  std::vector<Similarity> rows;
  for (const auto *image : {&before, &point, &curve, &hybrid}) {
    rows.push_back({intensity::rmse(reference.grey, *image), intensity::mutual_information(reference.grey, *image)});
  }
  std::ostringstream lines;
  const auto overlap =
      static_cast<double>(std::count_if(before.begin(), before.end(), [](float v) { return std::isfinite(v); }));
  lines << title << std::fixed << std::setprecision(1) << ", over the "
        << 100.0 * overlap / static_cast<double>(before.size()) << " % of the pixels that all four images cover"
        << "\n  registration quality        before     point     curve    hybrid";
  lines << "\n  error parameter (RMSE)  " << std::setprecision(4);
  for (const Similarity &row : rows) {
    lines << std::setw(10) << row.rmse;
  }
  lines << "\n  degree of matching (MI) ";
  for (const Similarity &row : rows) {
    lines << std::setw(10) << row.mi;
  }
  report.note(lines.str());
  report.add(
      with_peer(at_most("curves." + label + ".rmse.hybrid", rows[3].rmse, "grey", std::min(rows[1].rmse, rows[2].rmse)),
                rows[0].rmse, "before"));
  report.add(with_peer(at_least("curves." + label + ".mi.hybrid", rows[3].mi, "nats", std::max(rows[1].mi, rows[2].mi)),
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

} // namespace

void curve_figures(Report &report) {
  if (!is_present(report, kShared / "images/mni")) {
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
  Marks on_moved = on_one;
  for (auto *points : {&on_moved.landmarks, &on_moved.head}) {
    for (Eigen::Index i = 0; i < points->cols(); ++i) {
      points->col(i) = deformed(points->col(i));
    }
  }
  table_of(report, "Intra-subject: one person (reference), the same deformed smoothly by up to 9 mm (floating)",
           "known_deformation", one, moved, on_one, on_moved);
}

} // namespace bregma::bench
