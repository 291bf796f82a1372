#include "algorithms/mri/grid/grid_points.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>

#include "algorithms/mri/grid/slice_crossings.hpp"
#include "algorithms/mri/lattice.hpp"

namespace bregma::mri {

namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using geometry::Points3;
using Volume = image::Image<float, 3>;

constexpr double kSameColumn = 0.3; // of a cell: crossings of neighbouring slices that are one
constexpr double kSamePoint = 0.5;  // of a cell
// Of a cell: distances from the crossing at which a bar's profile is taken.
constexpr std::array kArms = {0.28, 0.36, 0.44};
constexpr double kMinWeight = 0.35;     // of the largest number of crossings: slices that show a plane of bars
constexpr double kBarContrast = 0.3;    // of the image's contrast
constexpr double kMinBars = 0.34;       // of the bars around a point that must be seen
constexpr int kPasses = 3;              // that follow the bars as the crossings found before bend them
constexpr std::size_t kMinProfiles = 2; // that show a bar across a coordinate; at the image's border there may be none
constexpr double kSameCell = 0.05;      // of the stated cell: a lattice that differs by more is searched with its own
constexpr double kNeighbour = 0.3;      // of a cell: how far a neighbour may lie from the lattice's step

class Sampler {
public:
  explicit Sampler(const Volume &volume) : volume_(volume), T_index_mm_(volume.T_image_index.inverse()) {
    std::vector<float> sorted = volume.voxels;
    const auto at = [&](double share) {
      const auto place = sorted.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
      std::nth_element(sorted.begin(), place, sorted.end());
      return static_cast<double>(*place);
    };
    contrast_ = at(0.98) - at(0.02);
  }

  [[nodiscard]] double contrast() const { return contrast_; } // between bars and surroundings

  // Trilinear; nothing outside.
  [[nodiscard]] std::optional<double> at(const Vector3d &mm) const {
    const Vector3d index = T_index_mm_.topLeftCorner<3, 3>() * mm + T_index_mm_.topRightCorner<3, 1>();
    std::array<int, 3> low{};
    Vector3d part;
    for (std::size_t d = 0; d < 3; ++d) {
      const double x = index[static_cast<Index>(d)];
      if (!(x >= 0.0 && x < volume_.size[d] - 1)) {
        return std::nullopt;
      }
      low[d] = static_cast<int>(x);
      part[static_cast<Index>(d)] = x - low[d];
    }
    double sum = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
      const int i = corner & 1, j = (corner >> 1) & 1, k = corner >> 2;
      sum += (i != 0 ? part.x() : 1.0 - part.x()) * (j != 0 ? part.y() : 1.0 - part.y()) *
             (k != 0 ? part.z() : 1.0 - part.z()) * static_cast<double>(volume_.at(low[0] + i, low[1] + j, low[2] + k));
    }
    return sum;
  }

private:
  const Volume &volume_;
  Eigen::Matrix4d T_index_mm_;
  double contrast_ = 0.0;
};

struct Candidate {
  Vector3d sum = Vector3d::Zero();
  double weight = 0.0;
  Vector3d last = Vector3d::Zero();
  [[nodiscard]] Vector3d mean() const { return sum / weight; }
};

struct Candidates {
  std::vector<Vector3d> points;
  int planes = 0;
};

// The chain of the paper along one axis of the image.
Candidates candidates_along(const Volume &image, int axis, const GridOptions &options) {
  const std::array<int, 3> order{(axis + 1) % 3, (axis + 2) % 3, axis};
  const auto size = [&](std::size_t d) { return image.size[static_cast<std::size_t>(order[d])]; };
  const Matrix3d axes = image.axes();
  const Eigen::Vector2d pixel(axes.col(order[0]).norm(), axes.col(order[1]).norm());
  SliceOptions slice_options{options.cell_mm, options.bar_mm, options.bright};
  std::vector<std::vector<Vector3d>> found(static_cast<std::size_t>(size(2)));
  std::array<int, 3> at{};
  std::vector<float> values(static_cast<std::size_t>(size(0)) * static_cast<std::size_t>(size(1)));
  std::size_t most = 1;
  for (int k = 0; k < size(2); ++k) {
    std::size_t n = 0;
    at[static_cast<std::size_t>(order[2])] = k;
    for (int j = 0; j < size(1); ++j) {
      at[static_cast<std::size_t>(order[1])] = j;
      for (int i = 0; i < size(0); ++i, ++n) {
        at[static_cast<std::size_t>(order[0])] = i;
        values[n] = image.at(at[0], at[1], at[2]);
      }
    }
    for (const Eigen::Vector2d &p : slice_crossings(values, size(0), size(1), pixel, slice_options)) {
      Vector3d index;
      index[order[0]] = p.x();
      index[order[1]] = p.y();
      index[order[2]] = k;
      found[static_cast<std::size_t>(k)].push_back(image.point_mm(index));
    }
    most = std::max(most, found[static_cast<std::size_t>(k)].size());
  }

  Candidates out;
  std::vector<Candidate> group;
  const auto close = [&] {
    out.planes += group.empty() ? 0 : 1;
    for (const Candidate &c : group) {
      out.points.push_back(c.mean());
    }
    group.clear();
  };
  for (const auto &slice : found) {
    const double weight = static_cast<double>(slice.size()) / static_cast<double>(most);
    if (weight < kMinWeight) {
      close();
      continue;
    }
    for (const Vector3d &p : slice) {
      const auto same = std::find_if(group.begin(), group.end(), [&](const Candidate &c) {
        return (c.last - p).norm() < kSameColumn * options.cell_mm;
      });
      Candidate &c = same != group.end() ? *same : group.emplace_back();
      c.sum += weight * p;
      c.weight += weight;
      c.last = p;
    }
  }
  close();
  return out;
}

// The centroid of a bar's profile along a direction, relative to the middle; nothing where no bar is seen.
std::optional<double> bar_offset(const Sampler &sampler, const Vector3d &middle, const Vector3d &across,
                                 const GridOptions &options) {
  constexpr double kStep_mm = 0.25;
  const int half = static_cast<int>(std::lround(1.6 * options.bar_mm / kStep_mm));
  std::vector<double> profile;
  for (int i = -half; i <= half; ++i) {
    const auto value = sampler.at(middle + i * kStep_mm * across);
    if (!value) {
      return std::nullopt;
    }
    profile.push_back(options.bright ? *value : -*value);
  }
  // The background is a line through the ends; a bar rises above it.
  const std::size_t end = profile.size();
  const double first = (profile[0] + profile[1] + profile[2]) / 3.0;
  const double last = (profile[end - 1] + profile[end - 2] + profile[end - 3]) / 3.0;
  const auto n = static_cast<double>(profile.size() - 1);
  double sum = 0.0, moment = 0.0, peak = 0.0;
  for (std::size_t i = 0; i < profile.size(); ++i) {
    const auto x = static_cast<double>(i);
    const double height = std::max(0.0, profile[i] - (first + (last - first) * x / n));
    peak = std::max(peak, height);
    sum += height;
    moment += height * (x - 0.5 * n) * kStep_mm;
  }
  if (!(peak > kBarContrast * sampler.contrast()) || !(sum > 0.0)) {
    return std::nullopt;
  }
  return moment / sum;
}

struct Refined {
  Vector3d point;
  double bars = 0.0;     // share of the profiles that show their bar
  bool complete = false; // each coordinate was measured
};

// Where the bars through a crossing run: at t cells along bar b, offset from the crossing. Distortion bends them.
struct BarPaths {
  Matrix3d tangent;                      // mm per cell
  Matrix3d curvature = Matrix3d::Zero(); // mm per cell squared
  [[nodiscard]] Vector3d at(Index b, double t) const { return t * tangent.col(b) + 0.5 * t * t * curvature.col(b); }
};

// axes: directions of the bars. Each coordinate from the bars that run across it.
Refined refine(const Sampler &sampler, Vector3d point, const Matrix3d &axes, const BarPaths &paths,
               const GridOptions &options) {
  constexpr int kRounds = 3;
  double seen = 0.0;
  bool complete = false;
  for (int round = 0; round < kRounds; ++round) {
    Vector3d move = Vector3d::Zero();
    seen = 0.0;
    complete = true;
    for (Index a = 0; a < 3; ++a) {
      std::vector<double> offsets;
      for (Index b = 0; b < 3; ++b) {
        if (b == a) {
          continue;
        }
        for (const double side : {1.0, -1.0}) {
          for (const double along : kArms) {
            const Vector3d arm = point + paths.at(b, side * along);
            if (const auto offset = bar_offset(sampler, arm, axes.col(a), options)) {
              offsets.push_back(*offset);
            }
          }
        }
      }
      seen += static_cast<double>(offsets.size()) / (12.0 * kArms.size());
      complete = complete && offsets.size() >= kMinProfiles;
      if (!offsets.empty()) {
        std::sort(offsets.begin(), offsets.end());
        const std::size_t n = offsets.size();
        move += 0.5 * (offsets[(n - 1) / 2] + offsets[n / 2]) * axes.col(a);
      }
    }
    point += move;
  }
  return {point, seen, complete};
}

// The bars through a crossing as the crossings around it bend them: a surface of second degree through all within two
// cells, of which the noise of each is a small part. At a face of the phantom the bars go to one side only, and a
// straight continuation of the lattice's mean direction would shift the crossing by the distortion's slope times the
// arm, up to 1 mm.
// With fewer crossings than such a surface needs: straight.
BarPaths paths_through(const std::vector<Refined> &points, const Vector3d &point, const Matrix3d &axes,
                       double cell_mm) {
  constexpr double kReach = 2.0;                // cells, along each axis
  constexpr double kWidth = 1.5;                // cells: standard deviation of the weights
  constexpr Index kTerms = 10, kMinPoints = 18; // of a surface of second degree in three variables
  Eigen::Matrix<double, Eigen::Dynamic, kTerms> A(static_cast<Index>(points.size()), kTerms);
  Eigen::Matrix<double, Eigen::Dynamic, 3> B(A.rows(), 3);
  Index rows = 0;
  for (const Refined &other : points) {
    const Vector3d cells = axes.transpose() * (other.point - point) / cell_mm;
    const Vector3d u = cells.array().round();
    if (u.cwiseAbs().maxCoeff() > kReach || (cells - u).norm() > kNeighbour) {
      continue;
    }
    const double weight = std::exp(-0.25 * u.squaredNorm() / (kWidth * kWidth));
    A.row(rows) << 1.0, u.x(), u.y(), u.z(), 0.5 * u.x() * u.x(), 0.5 * u.y() * u.y(), 0.5 * u.z() * u.z(),
        u.x() * u.y(), u.x() * u.z(), u.y() * u.z();
    A.row(rows) *= weight;
    B.row(rows++) = weight * (other.point - point).transpose();
  }
  if (rows < kMinPoints) {
    return {cell_mm * axes};
  }
  const Eigen::ColPivHouseholderQR<Eigen::Matrix<double, Eigen::Dynamic, kTerms>> qr(A.topRows(rows));
  if (qr.rank() < kTerms) {
    return {cell_mm * axes};
  }
  const Eigen::Matrix<double, kTerms, 3> terms = qr.solve(B.topRows(rows));
  return {terms.middleRows<3>(1).transpose(), terms.middleRows<3>(4).transpose()};
}

Matrix3d bar_axes(const Points3 &points, const Volume &image, double cell_mm) {
  const Points3 steps = lattice_steps(points, cell_mm).steps_mm;
  Matrix3d axes = image.axes().colwise().normalized();
  if (steps.cols() == 3) {
    // The nearest orthonormal axes to the lattice's steps.
    const Matrix3d directions = steps.colwise().normalized();
    const Eigen::JacobiSVD<Matrix3d> svd(directions, Eigen::ComputeFullU | Eigen::ComputeFullV);
    axes = svd.matrixU() * svd.matrixV().transpose();
  }
  return axes;
}

Points3 as_points(const std::vector<Vector3d> &list) {
  Points3 out(3, static_cast<Index>(list.size()));
  for (std::size_t i = 0; i < list.size(); ++i) {
    out.col(static_cast<Index>(i)) = list[i];
  }
  return out;
}

std::string length_text(double mm) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g mm", mm);
  return text.data();
}

std::string check(const Volume &image, const GridOptions &options) {
  if (!(options.cell_mm > 0.0) || !(options.bar_mm > 0.0) || !(2.0 * options.bar_mm < options.cell_mm)) {
    return "a cell of " + length_text(options.cell_mm) + " with bars of " + length_text(options.bar_mm) +
           " is out of range: a cell is wider than two bars";
  }
  if (options.axis < -1 || options.axis > 2) {
    return "axis " + std::to_string(options.axis) + " is none of the image";
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double spacing = image.spacing_mm()[static_cast<Index>(axis)];
    const double length = image.size[axis] * spacing;
    if (!(length > 2.0 * options.cell_mm)) {
      return "the image is " + length_text(length) + " long along axis " + std::to_string(axis + 1) +
             ", less than two cells";
    }
    if (spacing > 0.5 * options.cell_mm) {
      return "the voxels are " + length_text(spacing) + " long along axis " + std::to_string(axis + 1) +
             ", more than half a cell of " + length_text(options.cell_mm) + ": in which unit is the image?";
    }
  }
  const bool finite = std::all_of(image.voxels.begin(), image.voxels.end(), [](float v) { return std::isfinite(v); });
  return finite && image.voxels.size() == image.pixels() ? "" : "a voxel is missing or not finite";
}

// Distance of neighbouring crossings, on average over the lattice's directions; 0 where it has fewer than three.
double measured_cell(const Points3 &points) {
  const Points3 steps = lattice_steps(points).steps_mm;
  return steps.cols() == 3 ? steps.colwise().norm().mean() : 0.0;
}

tl::expected<GridPoints, std::string> search(const Volume &image, const GridOptions &options) {
  GridPoints out;
  Candidates best;
  for (int axis = 0; axis < 3; ++axis) {
    if (options.axis >= 0 && axis != options.axis) {
      continue;
    }
    Candidates found = candidates_along(image, axis, options);
    if (found.points.size() > best.points.size()) {
      best = std::move(found);
      out.axis = axis;
    }
  }
  const auto too_few = [&](std::size_t count) {
    return tl::unexpected(std::to_string(count) + " crossings of bars are seen, which are taken as " +
                          (options.bright ? "brighter" : "darker") +
                          " than what surrounds them; a grid phantom with cells of " + length_text(options.cell_mm) +
                          " has at least " + std::to_string(options.min_points));
  };
  if (best.points.size() < static_cast<std::size_t>(options.min_points)) {
    return too_few(best.points.size());
  }
  out.planes = best.planes;
  out.chain_mm = as_points(best.points);
  const Matrix3d axes = bar_axes(as_points(best.points), image, options.cell_mm);
  const BarPaths straight{options.cell_mm * axes};
  const Sampler sampler(image);
  std::vector<Refined> kept;
  std::vector<Vector3d> left_out;
  // False where no crossing is.
  const auto take = [&](const Vector3d &p) {
    Refined r = refine(sampler, p, axes, straight, options);
    if (r.bars < kMinBars || !r.complete || (r.point - p).norm() > kSamePoint * options.cell_mm) {
      return false;
    }
    const auto same = std::find_if(kept.begin(), kept.end(), [&](const Refined &k) {
      return (k.point - r.point).norm() < kSamePoint * options.cell_mm;
    });
    if (same == kept.end()) {
      kept.push_back(r);
    } else {
      ++out.merged;
      *same = r.bars > same->bars ? r : *same;
    }
    return true;
  };
  for (const Vector3d &p : best.points) {
    if (!take(p)) {
      left_out.push_back(p);
    }
  }
  const int doubled = out.merged;
  // Corners have no branches, and a broken bar may have lost one: where a neighbour is missing, it is looked for.
  for (std::size_t i = 0; i < kept.size(); ++i) {
    for (int side = 0; side < 6; ++side) {
      const Vector3d expected = kept[i].point + (side % 2 == 0 ? 1.0 : -1.0) * options.cell_mm * axes.col(side / 2);
      const bool known = std::any_of(kept.begin(), kept.end(), [&](const Refined &k) {
        return (k.point - expected).norm() < kSamePoint * options.cell_mm;
      });
      const std::size_t before = kept.size();
      if (!known && take(expected)) {
        out.completed += kept.size() > before ? 1 : 0;
      }
    }
  }
  out.merged = doubled;
  for (int pass = 0; pass < kPasses; ++pass) {
    const std::vector<Refined> before = kept;
    for (Refined &r : kept) {
      const Refined again =
          refine(sampler, r.point, axes, paths_through(before, r.point, axes, options.cell_mm), options);
      if (again.complete && (again.point - r.point).norm() < kSamePoint * options.cell_mm) {
        r = again;
      }
    }
  }
  // A crossing has neighbours in at least two directions of the lattice.
  std::vector<Vector3d> points;
  for (const Refined &r : kept) {
    int directions = 0;
    for (Index a = 0; a < 3; ++a) {
      const auto at_step = [&](const Refined &other) {
        const Vector3d d = other.point - r.point;
        return (d - options.cell_mm * axes.col(a)).norm() < kNeighbour * options.cell_mm ||
               (d + options.cell_mm * axes.col(a)).norm() < kNeighbour * options.cell_mm;
      };
      directions += std::any_of(kept.begin(), kept.end(), at_step) ? 1 : 0;
    }
    if (directions >= 2) {
      points.push_back(r.point);
      out.bars.push_back(r.bars);
    } else {
      left_out.push_back(r.point);
    }
  }
  if (points.size() < static_cast<std::size_t>(options.min_points)) {
    return too_few(points.size());
  }
  out.points_mm = as_points(points);
  out.left_out_mm = as_points(left_out);
  out.cell_mm = measured_cell(out.points_mm);
  return out;
}

} // namespace

tl::expected<GridPoints, std::string> find_grid_points(const Volume &image, const GridOptions &options) {
  if (const std::string problem = check(image, options); !problem.empty()) {
    return tl::unexpected(problem);
  }
  auto out = search(image, options);
  // Neighbours are looked for at the stated distance: with another one, crossings would be missed without a word.
  if (out && std::abs(out->cell_mm - options.cell_mm) > kSameCell * options.cell_mm) {
    GridOptions measured = options;
    measured.cell_mm = out->cell_mm;
    if (check(image, measured).empty()) {
      if (auto again = search(image, measured); again && again->points_mm.cols() >= out->points_mm.cols()) {
        return again;
      }
    }
  }
  return out;
}

} // namespace bregma::mri
