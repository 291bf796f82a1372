#include "algorithms/mri/lattice.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <Eigen/LU>
#include <Eigen/QR>

namespace bregma::mri {

namespace {

using Eigen::Index;
using Eigen::Vector3d;
using geometry::Points3;

constexpr double kNear = 1.5;      // of the median spacing: neighbours along an edge of a cell, not its diagonal
constexpr double kFar = 0.5;       // nearer ones are doubled
constexpr double kSameStep = 0.25; // of the spacing: distance of two displacements that count as the same
constexpr double kApart = 0.643;   // cosine of 50 degrees
constexpr std::size_t kMaxCandidates = 300;
// Parts of a step between a point and its place on the lattice, and the share of points that may be farther.
constexpr double kOffLattice = 0.25;
constexpr double kMaxOffShare = 0.05;

// For each point whether the number of steps from the first one is odd. Nothing where the points are no lattice.
std::vector<bool> odd_on_lattice(const Points3 &points_mm) {
  const LatticeSteps lattice = lattice_steps(points_mm);
  if (lattice.steps_mm.cols() < 3) {
    return {};
  }
  const Eigen::Matrix3d steps_of_mm = Eigen::Matrix3d(lattice.steps_mm).inverse();
  if (!steps_of_mm.allFinite()) {
    return {};
  }
  std::vector<bool> out;
  Index off = 0;
  for (const auto &p : points_mm.colwise()) {
    const Vector3d steps = steps_of_mm * (p - points_mm.col(0));
    const Vector3d whole = steps.array().round();
    off += (steps - whole).cwiseAbs().maxCoeff() > kOffLattice ? 1 : 0;
    out.push_back(std::fmod(std::abs(whole.sum()), 2.0) == 1.0);
  }
  return static_cast<double>(off) <= kMaxOffShare * static_cast<double>(points_mm.cols()) ? out : std::vector<bool>{};
}

} // namespace

std::vector<double> nearest_distances(const Points3 &points_mm) {
  std::vector<double> out;
  out.reserve(static_cast<std::size_t>(points_mm.cols()));
  for (Index i = 0; i < points_mm.cols(); ++i) {
    Eigen::VectorXd d = (points_mm.colwise() - points_mm.col(i)).colwise().squaredNorm();
    d[i] = std::numeric_limits<double>::infinity();
    out.push_back(std::sqrt(d.minCoeff()));
  }
  return out;
}

double median(std::vector<double> values) {
  if (values.empty()) {
    return 0.0;
  }
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

LatticeSteps lattice_steps(const Points3 &points_mm, double spacing_mm) {
  LatticeSteps out;
  out.spacing_mm = spacing_mm > 0.0 ? spacing_mm : median(nearest_distances(points_mm));
  std::vector<Vector3d> displacements;
  for (Index i = 0; i < points_mm.cols(); ++i) {
    for (Index j = i + 1; j < points_mm.cols(); ++j) {
      const Vector3d d = points_mm.col(j) - points_mm.col(i);
      if (d.norm() < kNear * out.spacing_mm && d.norm() > kFar * out.spacing_mm) {
        displacements.push_back(d);
      }
    }
  }
  std::vector<Vector3d> found;
  const std::size_t stride = std::max<std::size_t>(1, displacements.size() / kMaxCandidates);
  while (found.size() < 3) {
    std::size_t most = 0;
    Vector3d best = Vector3d::Zero();
    for (std::size_t c = 0; c < displacements.size(); c += stride) {
      const Vector3d &candidate = displacements[c];
      if (std::any_of(found.begin(), found.end(), [&](const Vector3d &f) {
            return std::abs(f.normalized().dot(candidate.normalized())) > kApart;
          })) {
        continue;
      }
      std::size_t supporters = 0;
      Vector3d sum = Vector3d::Zero();
      for (const Vector3d &d : displacements) {
        const Vector3d same = d.dot(candidate) < 0.0 ? Vector3d(-d) : d;
        if ((same - candidate).norm() < kSameStep * out.spacing_mm) {
          ++supporters;
          sum += same;
        }
      }
      if (supporters > most) {
        most = supporters;
        best = sum / static_cast<double>(supporters);
      }
    }
    if (most == 0) {
      break;
    }
    found.push_back(best);
  }
  out.steps_mm.resize(3, static_cast<Index>(found.size()));
  for (std::size_t i = 0; i < found.size(); ++i) {
    out.steps_mm.col(static_cast<Index>(i)) = found[i];
  }
  return out;
}

std::optional<double> bend_mm(const Points3 &points_mm) {
  constexpr int kRounds = 5;
  constexpr double kBetween = 0.25; // of a step, along any of them
  constexpr double kMaxBetween = 0.2;
  const Points3 start = lattice_steps(points_mm).steps_mm;
  if (start.cols() < 3) {
    return std::nullopt;
  }
  Eigen::Matrix3d steps = start;
  const Vector3d middle = points_mm.rowwise().mean();
  Index centre = 0;
  (points_mm.colwise() - middle).colwise().squaredNorm().minCoeff(&centre);
  Vector3d origin = points_mm.col(centre);
  double rms = 0.0;
  Index between = 0;
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::Matrix3d steps_of_mm = steps.inverse();
    if (!steps_of_mm.allFinite()) {
      return std::nullopt;
    }
    const Points3 at = steps_of_mm * (points_mm.colwise() - origin);
    const Points3 place = at.array().round();
    between = ((at - place).cwiseAbs().colwise().maxCoeff().array() > kBetween).count();
    Eigen::Matrix<double, Eigen::Dynamic, 4> A(points_mm.cols(), 4);
    A << place.transpose(), Eigen::VectorXd::Ones(points_mm.cols());
    const Eigen::Matrix<double, 4, 3> fit = A.colPivHouseholderQr().solve(points_mm.transpose());
    steps = fit.topRows<3>().transpose();
    origin = fit.row(3).transpose();
    rms = std::sqrt((A * fit - points_mm.transpose()).rowwise().squaredNorm().mean());
  }
  return static_cast<double>(between) <= kMaxBetween * static_cast<double>(points_mm.cols()) ? std::optional(rms)
                                                                                             : std::nullopt;
}

Halves every_other(const Points3 &points_mm) {
  const std::vector<bool> odd = odd_on_lattice(points_mm);
  Halves out;
  for (Index i = 0; i < points_mm.cols(); ++i) {
    const bool held_out = odd.empty() ? i % 2 == 1 : odd[static_cast<std::size_t>(i)];
    (held_out ? out.held_out : out.used).push_back(i);
  }
  return out;
}

} // namespace bregma::mri
