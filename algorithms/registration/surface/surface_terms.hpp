// Traced skin as point-to-plane terms of the joint estimate, with the correlation of neighbouring samples.
//
// Residual s_i = n_i' (T p_i - c_i), error covariance K_ij = scale^2 (sigma^2 rho_ij + delta_ij own_i), with
// rho = exp(-d^2 / 2 l^2). The full matrix K is too expensive at 10 Hz. The weights are therefore those of its
// diagonal, with sigma^2 multiplied by the sample's sum of correlations. The covariance of the estimate uses K exactly.
#pragma once

#include <vector>

#include "algorithms/registration/registration.hpp"
#include "algorithms/surface/neighbours.hpp"

namespace bregma::registration {

class SurfaceTerms {
public:
  SurfaceTerms(const surface::SurfaceModel *surface, double sigma_mm, double correlation_length_mm, int capacity);

  void set_samples(std::span<const SurfaceSample> samples) noexcept;
  // Closest points, residuals and weights at this pose. rescale: derive the noise scale and the reach of Tukey's
  // weights from the present residuals. Without it they stay constant, so that the last iterations converge.
  void linearise(const ImageFromReference &T_image_reference, const Vector3d &centre, bool rescale) noexcept;
  // Adds J'WJ and J'Wr.
  void add_to(Matrix6d &normal, geometry::Vector6d &gradient) const noexcept;
  // J'W K W J: the covariance of the gradient.
  [[nodiscard]] Matrix6d gradient_covariance() const noexcept;

  [[nodiscard]] int count() const noexcept { return count_; }
  [[nodiscard]] int left_out() const noexcept;
  [[nodiscard]] double rms_mm() const noexcept; // over the samples with a weight
  [[nodiscard]] double scale() const noexcept { return scale_; }
  [[nodiscard]] double effective() const noexcept; // effective number of independent samples

private:
  struct Term {
    geometry::Vector6d jacobian;
    double residual = 0.0;
    double own = 0.0;    // variance along the normal
    double robust = 0.0; // Tukey's weight, 0 to 1
    double weight = 0.0;
  };

  const surface::SurfaceModel *surface_;
  double variance_;
  int count_ = 0;
  double scale_ = 1.0;
  double reach_ = 0.0; // standardised residual beyond which a sample has no weight
  std::vector<SurfaceSample> samples_;
  std::vector<Vector3d> places_; // positions of the samples, in Reference
  surface::Neighbours neighbours_;
  std::vector<double> correlation_sum_; // sum of correlations with all samples, at least 1
  std::vector<int> triangle_;           // warm start of the next closest-point query
  std::vector<Term> terms_;
  std::vector<double> scratch_;
};

} // namespace bregma::registration
