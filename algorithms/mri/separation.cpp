#include "algorithms/mri/separation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include "algorithms/registration/points/paired_points.hpp"

namespace bregma::mri {

namespace {

using Eigen::Index;
using Eigen::Vector3d;
using geometry::Points3;

// B0 displaces the scans alike where their d_s differ by less than this, relative to the largest.
constexpr double kMinDifference = 0.05;

bool shows(const PhantomScan &scan, Index i) { return scan.imaged_mm.col(i).allFinite(); }

std::string problem(const Points3 &true_mm, std::span<const PhantomScan> scans) {
  if (scans.size() < 2) {
    return "one scan does not separate gradients and B0: give scans with opposed read-outs or in three orientations";
  }
  double largest = 0.0, difference = 0.0;
  for (const PhantomScan &scan : scans) {
    if (scan.imaged_mm.cols() != true_mm.cols()) {
      return std::to_string(true_mm.cols()) + " true points but " + std::to_string(scan.imaged_mm.cols()) +
             " imaged ones";
    }
    if (!scan.mm_per_Hz.allFinite()) {
      return "the displacement by B0 is not finite";
    }
    largest = std::max(largest, scan.mm_per_Hz.norm());
    difference = std::max(difference, (scan.mm_per_Hz - scans[0].mm_per_Hz).norm());
  }
  return difference > kMinDifference * largest && largest > 0.0
             ? ""
             : "B0 displaces all scans alike: give scans with opposed read-outs or in three orientations";
}

// How differently B0 displaces a point in the scans that show it.
double difference_at(std::span<const PhantomScan> scans, Index i) {
  const PhantomScan *first = nullptr;
  double out = 0.0;
  for (const PhantomScan &scan : scans) {
    if (shows(scan, i)) {
      first = first == nullptr ? &scan : first;
      out = std::max(out, (scan.mm_per_Hz - first->mm_per_Hz).norm());
    }
  }
  return out;
}

// What the scans show on average once B0 is taken out.
Points3 without_b0(std::span<const PhantomScan> scans, const Eigen::VectorXd &b0_Hz) {
  Points3 out = Points3::Zero(3, b0_Hz.size());
  for (Index i = 0; i < b0_Hz.size(); ++i) {
    int count = 0;
    for (const PhantomScan &scan : scans) {
      if (shows(scan, i)) {
        out.col(i) += scan.imaged_mm.col(i) - b0_Hz[i] * scan.mm_per_Hz;
        ++count;
      }
    }
    out.col(i) /= count;
  }
  return out;
}

// What is missing in B0 at each point, from what gradients and B0 leave, by least squares over the scans.
Eigen::VectorXd b0_at_points(std::span<const PhantomScan> scans, const Points3 &by_gradients,
                             const Eigen::VectorXd &b0_Hz) {
  Eigen::VectorXd out(by_gradients.cols());
  for (Index i = 0; i < out.size(); ++i) {
    double above = 0.0, below = 0.0;
    for (const PhantomScan &scan : scans) {
      if (shows(scan, i)) {
        above += scan.mm_per_Hz.dot(scan.imaged_mm.col(i) - by_gradients.col(i) - b0_Hz[i] * scan.mm_per_Hz);
        below += scan.mm_per_Hz.squaredNorm();
      }
    }
    out[i] = below > 0.0 ? above / below : 0.0;
  }
  return out;
}

} // namespace

Vector3d b0_movement(const Vector3d &read_out, double pixel_mm, double bandwidth_Hz, const Vector3d &normal,
                     double thickness_mm, double pulse_Hz) {
  Vector3d out = read_out * (pixel_mm / bandwidth_Hz);
  if (pulse_Hz > 0.0) {
    out += normal * (thickness_mm / pulse_Hz);
  }
  return out;
}

PhantomScan phantom_scan(const MatchResult &match, Index reference, const Points3 &imaged_mm,
                         const Vector3d &mm_per_Hz) {
  PhantomScan out{Points3::Constant(3, reference, std::numeric_limits<double>::quiet_NaN()), mm_per_Hz};
  for (const MatchedPair &pair : match.pairs) {
    out.imaged_mm.col(pair.reference) = imaged_mm.col(pair.imaged);
  }
  return out;
}

std::optional<Points3> place_reference(const Points3 &reference_mm, std::span<const PhantomScan> scans) {
  std::vector<Vector3d> from, to;
  for (Index i = 0; i < reference_mm.cols(); ++i) {
    Vector3d mean = Vector3d::Zero();
    for (const PhantomScan &scan : scans) {
      mean += scan.imaged_mm.col(i) / static_cast<double>(scans.size());
    }
    if (mean.allFinite()) {
      from.emplace_back(reference_mm.col(i));
      to.push_back(mean);
    }
  }
  const auto T = registration::fit_rigid(from, to);
  if (!T) {
    return std::nullopt;
  }
  Points3 out(3, reference_mm.cols());
  for (Index i = 0; i < reference_mm.cols(); ++i) {
    out.col(i) = *T * Vector3d(reference_mm.col(i));
  }
  return out;
}

Vector3d SeparatedField::to_imaged(const Vector3d &true_mm, const Vector3d &mm_per_Hz) const {
  return gradients.to_imaged(true_mm) + b0_Hz(true_mm) * mm_per_Hz;
}

std::optional<Vector3d> SeparatedField::to_true(const Vector3d &imaged_mm, const Vector3d &mm_per_Hz) const {
  constexpr int kSteps = 60;
  Vector3d p = imaged_mm;
  for (int step = 0; step < kSteps; ++step) { // contracts while the displacement's slope is below 1
    const Vector3d move = imaged_mm - to_imaged(p, mm_per_Hz);
    if (!(move.norm() < 1e6)) {
      return std::nullopt;
    }
    p += move;
    if (move.norm() < 1e-6) {
      return p;
    }
  }
  return std::nullopt;
}

std::vector<ScanPlacement> relative_placements(const Points3 &true_mm, std::span<const PhantomScan> scans) {
  constexpr Index kMinShown = 12;
  std::vector<ScanPlacement> out(scans.size());
  Eigen::Matrix3d moved = Eigen::Matrix3d::Zero(); // by B0
  for (const PhantomScan &scan : scans) {
    moved += scan.mm_per_Hz * scan.mm_per_Hz.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(moved);
  Eigen::Matrix3d P = Eigen::Matrix3d::Zero(); // onto the directions that B0 does not move along
  for (Index d = 0; d < 3; ++d) {
    if (axes.eigenvalues()[d] < kMinDifference * kMinDifference * axes.eigenvalues()[2]) {
      P += axes.eigenvectors().col(d) * axes.eigenvectors().col(d).transpose();
    }
  }
  for (std::size_t s = 1; s < scans.size(); ++s) {
    std::vector<Index> both;
    for (Index i = 0; i < true_mm.cols(); ++i) {
      if (shows(scans[0], i) && shows(scans[s], i)) {
        both.push_back(i);
      }
    }
    const auto n = static_cast<Index>(both.size());
    if (n < kMinShown || P.isZero()) {
      continue;
    }
    Eigen::MatrixX4d A(n, 4);
    Eigen::MatrixX3d b(n, 3);
    for (Index row = 0; row < n; ++row) {
      const Index i = both[static_cast<std::size_t>(row)];
      A.row(row) << 1.0, true_mm.col(i).transpose();
      b.row(row) = (P * (scans[s].imaged_mm.col(i) - scans[0].imaged_mm.col(i))).transpose();
    }
    const Eigen::Matrix<double, 4, 3> x = A.colPivHouseholderQr().solve(b);
    out[s].shift_mm = x.row(0).transpose();
    out[s].slope = x.bottomRows<3>().transpose();
  }
  return out;
}

PhantomScan without(const ScanPlacement &placement, const Points3 &true_mm, PhantomScan scan) {
  scan.imaged_mm -= (placement.slope * true_mm).colwise() + placement.shift_mm;
  return scan;
}

tl::expected<SeparatedField, std::string> separate_fields(const Points3 &true_mm, std::span<const PhantomScan> scans,
                                                          const SeparationOptions &options) {
  if (const std::string text = problem(true_mm, scans); !text.empty()) {
    return tl::unexpected(text);
  }
  double largest = 0.0;
  for (const PhantomScan &scan : scans) {
    largest = std::max(largest, scan.mm_per_Hz.norm());
  }
  std::vector<Index> shown; // others say nothing about B0
  for (Index i = 0; i < true_mm.cols(); ++i) {
    if (difference_at(scans, i) > kMinDifference * largest) {
      shown.push_back(i);
    }
  }
  const Points3 real = true_mm(Eigen::all, shown);
  std::vector<PhantomScan> kept;
  for (const PhantomScan &scan : scans) {
    kept.push_back({scan.imaged_mm(Eigen::all, shown), scan.mm_per_Hz});
  }
  Eigen::VectorXd b0 = Eigen::VectorXd::Zero(real.cols());
  int iterations = 0;
  double change = std::numeric_limits<double>::infinity();
  while (iterations < options.max_iterations && change > options.tolerance_mm) {
    const Eigen::VectorXd next = b0 + b0_at_points(kept, without_b0(kept, b0), b0);
    change = b0.size() > 0 ? (next - b0).cwiseAbs().maxCoeff() * largest : 0.0;
    b0 = next;
    ++iterations;
  }
  auto series = HarmonicSeries::fit(real, b0);
  if (!series) {
    return tl::unexpected("B0: " + series.error());
  }
  for (Index i = 0; i < real.cols(); ++i) {
    b0[i] = (*series)(real.col(i));
  }
  auto gradients = DistortionField::fit(real, without_b0(kept, b0));
  if (!gradients) {
    return tl::unexpected("gradients: " + gradients.error());
  }
  return SeparatedField{std::move(*gradients), std::move(*series), iterations, change};
}

Points3 residuals(const SeparatedField &field, const Points3 &true_mm, const PhantomScan &scan) {
  Points3 out = Points3::Constant(3, true_mm.cols(), std::numeric_limits<double>::quiet_NaN());
  for (Index i = 0; i < true_mm.cols(); ++i) {
    if (!shows(scan, i)) {
      continue;
    }
    if (const auto corrected = field.to_true(scan.imaged_mm.col(i), scan.mm_per_Hz)) {
      out.col(i) = true_mm.col(i) - *corrected;
    }
  }
  return out;
}

} // namespace bregma::mri
