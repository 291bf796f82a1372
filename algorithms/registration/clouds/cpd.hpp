// Coherent point drift: registers two clouds without known correspondences by letting the moved sources be the centres
// of Gaussians of one sigma that explain the targets, beside a uniform density for outliers, and raising the likelihood
// by expectation-maximisation. Rigid, similar (free scale) and affine: Myronenko & Song, "Point set registration:
// coherent point drift", IEEE PAMI 32(12), 2010, figures 2 and 3. It tells
// which marker of a phantom is which where their order is unknown and some are spurious or missing.
//
// Two things differ from the paper. Outliers are uniform over the targets' bounding box instead of having the density
// 1/N in normalised coordinates, so that the outlier weight means the same for 100 and for 10,000 points. And the
// M-step works with the residuals x - y instead of x, so that sigma can fall to a millionth of the cloud without
// cancellation. Sums: gauss_sums.hpp, with its error.
//
// It follows the likelihood uphill: a start within about 60 degrees is needed for a head or a bunny; cloud_pose.hpp
// starts from everywhere. Units: mm, any frame. Reentrant; allocates; starts options.threads - 1 threads per iteration.
#pragma once

#include <vector>

#include "algorithms/geometry/points.hpp"

namespace bregma::registration {

enum class CpdModel { kRigid, kSimilarity, kAffine };

struct CpdOptions {
  CpdModel model = CpdModel::kRigid;
  double outlier_weight = 0.1; // w, the share of targets that belong to no source; 0 to below 1
  double start_sigma_mm = 0.0; // 0: from the clouds, figure 2 of the paper
  double min_sigma = 1e-6;     // of the targets' size; reached by clouds without noise
  double tolerance = 1e-6;     // RMS motion of the sources in one iteration, of the targets' size
  int max_iterations = 300;
  int threads = 1;
};

enum class CpdOutcome {
  kConverged,
  kNotConverged, // max_iterations: the estimate is there
  kTooFewPoints, // fewer than D + 1 on a side
  kNotFinite,    // a coordinate or an option
  kNoOverlap,    // all targets became outliers
  kDegenerate    // points on a line (rigid: in space; affine: in a plane too)
};
[[nodiscard]] const char *name(CpdOutcome outcome) noexcept;

template <int D> struct CpdTransform { // target = linear * source + translation
  Eigen::Matrix<double, D, D> linear = Eigen::Matrix<double, D, D>::Identity();
  Eigen::Matrix<double, D, 1> translation = Eigen::Matrix<double, D, 1>::Zero();
  [[nodiscard]] geometry::Points<D> operator*(const geometry::Points<D> &points) const {
    return (linear * points).colwise() + translation;
  }
};

template <int D> struct CpdResult {
  CpdOutcome outcome = CpdOutcome::kTooFewPoints;
  int iterations = 0;
  CpdTransform<D> transform;
  Eigen::Matrix<double, D, D> rotation = Eigen::Matrix<double, D, D>::Identity(); // affine: its nearest rotation
  double scale = 1.0;          // affine: the D-th root of its determinant
  double sigma_mm = 0.0;       // of a coordinate of what remains
  double outlier_share = 0.0;  // of the targets, by the posterior
  double log_likelihood = 0.0; // a target, of the last E-step; between starts of the same clouds, the larger wins
  bool has_estimate() const { return outcome == CpdOutcome::kConverged || outcome == CpdOutcome::kNotConverged; }
};

// start: maps the sources to near the targets; by default the centroids are laid on each other, unturned.
template <int D>
[[nodiscard]] CpdResult<D> register_cpd(const geometry::Points<D> &source_mm, const geometry::Points<D> &target_mm,
                                        const CpdOptions &options, const CpdTransform<D> *start = nullptr);

// Who belongs to whom under eq. (6). Exact, in time sources x targets.
struct CpdCorrespondence {
  int index = -1;           // on the other side
  double probability = 0.0; // P(source | target)
};
struct CpdCorrespondences {
  std::vector<CpdCorrespondence> of_source; // the target with the largest P
  std::vector<CpdCorrespondence> of_target; // the source with the largest P
};
template <int D>
[[nodiscard]] CpdCorrespondences correspondences(const geometry::Points<D> &moved_source_mm,
                                                 const geometry::Points<D> &target_mm, double sigma_mm,
                                                 double outlier_constant);

// c of eq. (6) where a share w of the targets is uniform over their bounding box (sides of at least a tenth of the
// longest).
template <int D>
[[nodiscard]] double outlier_constant(const geometry::Points<D> &target_mm, double sigma_mm, double outlier_weight,
                                      Eigen::Index sources);

} // namespace bregma::registration
