// Traced skin as point-to-plane terms of the joint estimate, with the correlation of neighbouring samples.
//
// Residual s_i = n_i' (T p_i - c_i), error covariance K_ij = scale^2 (sigma^2 rho_ij + delta_ij own_i), with
// rho = exp(-d^2 / 2 l^2). The full matrix K is too expensive at 10 Hz. The weights are therefore those of its
// diagonal, with sigma^2 multiplied by the sample's sum of correlations. The covariance of the estimate uses K exactly.
//
// Unknowns are the twist about a centre (6), and with samples of a range sensor the excess on tilted skin with its
// slopes (9; tilt_excess.hpp). A sample is then raised along its beam by what the excess at its tilt is.
#pragma once

#include <vector>

#include "algorithms/registration/registration.hpp"
#include "algorithms/surface/neighbours.hpp"

namespace bregma::registration {

class SurfaceTerms {
public:
  static constexpr int kPose = 6, kWithExcess = 9; // unknowns
  template <int Unknowns> using Matrix = Eigen::Matrix<double, Unknowns, Unknowns>;
  template <int Unknowns> using Vector = Eigen::Matrix<double, Unknowns, 1>;

  SurfaceTerms(const surface::SurfaceModel *surface, const RegistrationOptions &options, int capacity);

  void set_samples(std::span<const SurfaceSample> samples) noexcept;
  // Closest points, residuals and weights at this pose and excess. rescale: derive the noise scale, the reach of
  // Tukey's weights and the tilts from the present residuals. Without it they stay constant, so that the last
  // iterations converge.
  void linearise(const ImageFromReference &T_image_reference, const Vector3d &centre, const Vector3d &excess_mm,
                 bool rescale) noexcept;
  // Adds J'WJ and J'Wr.
  template <int Unknowns> void add_to(Matrix<Unknowns> &normal, Vector<Unknowns> &gradient) const noexcept;
  // J'W K W J: the covariance of the gradient.
  template <int Unknowns> [[nodiscard]] Matrix<Unknowns> gradient_covariance() const noexcept;

  [[nodiscard]] int count() const noexcept { return count_; }
  [[nodiscard]] int beam_count() const noexcept { return beam_count_; } // of them, those by a range sensor
  [[nodiscard]] int left_out() const noexcept;
  [[nodiscard]] double rms_mm() const noexcept; // over the samples with a weight
  [[nodiscard]] double scale() const noexcept { return scale_; }
  [[nodiscard]] double effective() const noexcept; // effective number of independent samples

private:
  struct Term {
    Vector<kWithExcess> jacobian;
    Vector3d tilt = Vector3d::Zero(); // excess_terms of a sample by a range sensor
    bool too_steep = false;
    double residual = 0.0;
    double own = 0.0;    // variance along the normal
    double robust = 0.0; // Tukey's weight, 0 to 1
    double weight = 0.0;
  };

  const surface::SurfaceModel *surface_;
  double variance_;
  double min_cosine_;
  int count_ = 0, beam_count_ = 0;
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
