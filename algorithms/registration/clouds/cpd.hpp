// Coherent point drift registers two clouds without known correspondences: rigid, with free scale, or affine
// [Myronenko 2010, figures 2 and 3]. The moved sources are the centres of Gaussians of one sigma that explain the
// targets; outliers have a uniform density. Expectation-maximisation increases the likelihood. The method finds the
// correspondences of a phantom's markers where their order is unknown and some are spurious or missing.
//
// There are two differences from the paper. Outliers are uniform over the targets' bounding box instead of having the
// density 1/N in normalised coordinates, so that the outlier weight means the same for 100 and for 10,000 points. The
// M-step works with the residuals x - y instead of x, so that sigma can decrease to a millionth of the cloud's size
// without cancellation. Sums: gauss_sums.hpp, with its error.
//
// It finds a local maximum: a head or a bunny needs a start within about 60 degrees; cloud_pose.hpp starts from many
// rotations. Units: mm, any frame. Reentrant; allocates; starts options.threads - 1 threads per iteration.
#pragma once

#include <vector>

#include "algorithms/geometry/points.hpp"

namespace bregma::registration {

enum class CpdModel { kRigid, kSimilarity, kAffine };

struct CpdOptions {
  CpdModel model = CpdModel::kRigid;
  double outlier_weight = 0.1; // w, the fraction of targets without a source; 0 to below 1
  double start_sigma_mm = 0.0; // 0: from the clouds [Myronenko 2010, figure 2]
  double min_sigma = 1e-6;     // relative to the targets' size; reached by clouds without noise
  double tolerance = 1e-6;     // RMS motion of the sources in one iteration, relative to the targets' size
  int max_iterations = 300;
  int threads = 1;
};

enum class CpdOutcome {
  kConverged,
  kNotConverged, // max_iterations reached; the estimate is available
  kTooFewPoints, // fewer than D + 1 points on a side
  kNotFinite,    // a coordinate or an option is not finite
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
  Eigen::Matrix<double, D, D> rotation = Eigen::Matrix<double, D, D>::Identity(); // affine: the nearest rotation
  double scale = 1.0;         // affine: the D-th root of its determinant
  double sigma_mm = 0.0;      // residual per coordinate
  double outlier_share = 0.0; // fraction of the targets, by the posterior
  double log_likelihood =
      0.0; // per target, of the last E-step; of several starts on the same clouds, the largest is the best
  bool has_estimate() const { return outcome == CpdOutcome::kConverged || outcome == CpdOutcome::kNotConverged; }
};

// start: maps the sources close to the targets; by default the centroids coincide, without rotation.
template <int D>
[[nodiscard]] CpdResult<D> register_cpd(const geometry::Points<D> &source_mm, const geometry::Points<D> &target_mm,
                                        const CpdOptions &options, const CpdTransform<D> *start = nullptr);

// Correspondences by the posterior of [Myronenko 2010, eq. 6]. Exact; time is proportional to sources x targets.
struct CpdCorrespondence {
  int index = -1;           // index in the other cloud
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

// c of [Myronenko 2010, eq. 6] where a fraction w of the targets is uniform over their bounding box (sides of at least
// a tenth of the longest).
template <int D>
[[nodiscard]] double outlier_constant(const geometry::Points<D> &target_mm, double sigma_mm, double outlier_weight,
                                      Eigen::Index sources);

} // namespace bregma::registration
