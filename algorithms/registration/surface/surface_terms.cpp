#include "algorithms/registration/surface/surface_terms.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/registration/surface/tilt_excess.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::registration {

namespace {
constexpr double kTukey = 4.685; // 95 % efficient for normal errors
const double kMadToSigma =
    1.0 / uncertainty::normal_quantile(0.75); // median of |x| to standard deviation, normal errors
constexpr double kOnSurface_mm = 1e-6;        // nearer than this, the surface's own normal is used

bool is_by_beam(const SurfaceSample &sample) { return !sample.towards_sensor.isZero(); }
} // namespace

SurfaceTerms::SurfaceTerms(const surface::SurfaceModel *surface, const RegistrationOptions &options, int capacity)
    : surface_(surface), variance_(options.surface_sigma_mm * options.surface_sigma_mm),
      min_cosine_(std::cos(options.max_tilt_rad)),
      neighbours_(options.correlation_length_mm, static_cast<std::size_t>(std::max(capacity, 0))) {
  const auto n = static_cast<std::size_t>(std::max(capacity, 0));
  samples_.resize(n);
  places_.resize(n);
  correlation_sum_.resize(n);
  triangle_.resize(n, -1);
  terms_.resize(n);
  scratch_.resize(n);
}

void SurfaceTerms::set_samples(std::span<const SurfaceSample> samples) noexcept {
  const std::size_t offered = surface_ == nullptr ? 0 : std::min(samples.size(), samples_.size());
  std::size_t n = 0;
  beam_count_ = 0;
  for (std::size_t i = 0; i < offered; ++i) {
    if (samples[i].reference_mm.allFinite()) {
      samples_[n] = samples[i];
      terms_[n].tilt.setZero();
      terms_[n].too_steep = false;
      beam_count_ += is_by_beam(samples[i]) ? 1 : 0;
      places_[n] = samples[i].reference_mm;
      correlation_sum_[n++] = 1.0;
    }
  }
  count_ = static_cast<int>(n);
  neighbours_.set({places_.data(), n});
  neighbours_.each([this](std::size_t i, std::size_t j, double rho) {
    correlation_sum_[i] += rho;
    correlation_sum_[j] += rho;
  });
  scale_ = 1.0;
}

void SurfaceTerms::linearise(const ImageFromReference &T_image_reference, const Vector3d &centre,
                             const Vector3d &excess_mm, bool rescale) noexcept {
  const auto n = static_cast<std::size_t>(count_);
  const Matrix3d R = T_image_reference.rotation_matrix();
  for (std::size_t i = 0; i < n; ++i) {
    Term &term = terms_[i];
    const Vector3d up = R * samples_[i].towards_sensor; // zero of touched skin
    const Vector3d mapped =
        R * samples_[i].reference_mm + T_image_reference.translation() + term.tilt.dot(excess_mm) * up;
    const surface::SurfacePoint on = surface_->closest(mapped, triangle_[i]);
    triangle_[i] = on.triangle;
    if (rescale && is_by_beam(samples_[i])) {
      term.tilt = excess_terms(on.normal, up, R * samples_[i].across);
      term.too_steep = on.normal.dot(up) < min_cosine_;
    }
    // The gradient of the distance itself, also over an edge, where a facet's normal and the estimate would jump.
    const Vector3d normal =
        on.distance_mm > kOnSurface_mm ? Vector3d((mapped - on.point_mm) / on.signed_mm) : on.normal;
    term.jacobian.head<3>() = (mapped - centre).cross(normal);
    term.jacobian.segment<3>(3) = normal;
    term.jacobian.tail<3>() = normal.dot(up) * term.tilt;
    term.residual = on.signed_mm;
    const Vector3d normal_in_reference = R.transpose() * normal;
    term.own = normal_in_reference.dot(samples_[i].covariance * normal_in_reference);
    scratch_[i] = std::abs(term.residual) / std::sqrt(variance_ + term.own);
  }
  if (rescale && n > 0) {
    const auto middle = scratch_.begin() + static_cast<std::ptrdiff_t>(n / 2);
    std::nth_element(scratch_.begin(), middle, scratch_.begin() + static_cast<std::ptrdiff_t>(n));
    scale_ = std::max(1.0, kMadToSigma * *middle);
    reach_ = kTukey * scale_;
  }
  for (std::size_t i = 0; i < n; ++i) {
    Term &term = terms_[i];
    const double z = term.residual / (reach_ * std::sqrt(variance_ + term.own));
    const double inside = std::max(0.0, 1.0 - z * z);
    term.robust = term.too_steep ? 0.0 : inside * inside;
    term.weight = term.robust / (scale_ * scale_ * (variance_ * correlation_sum_[i] + term.own));
  }
}

template <int Unknowns> void SurfaceTerms::add_to(Matrix<Unknowns> &normal, Vector<Unknowns> &gradient) const noexcept {
  for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
    const Term &term = terms_[i];
    const auto jacobian = term.jacobian.head<Unknowns>();
    const Vector<Unknowns> weighted = term.weight * jacobian;
    normal += weighted * jacobian.transpose();
    gradient += weighted * term.residual;
  }
}

template <int Unknowns> SurfaceTerms::Matrix<Unknowns> SurfaceTerms::gradient_covariance() const noexcept {
  Matrix<Unknowns> between = Matrix<Unknowns>::Zero();
  // The pairs of one i are consecutive: their sum over j is computed first, so that each i costs one outer product.
  std::size_t row = 0;
  Vector<Unknowns> sum = Vector<Unknowns>::Zero();
  neighbours_.each([&](std::size_t i, std::size_t j, double rho) {
    if (i != row) {
      between += terms_[row].weight * terms_[row].jacobian.template head<Unknowns>() * sum.transpose();
      sum.setZero();
      row = i;
    }
    sum += rho * terms_[j].weight * terms_[j].jacobian.template head<Unknowns>();
  });
  if (count_ > 0) {
    between += terms_[row].weight * terms_[row].jacobian.head<Unknowns>() * sum.transpose();
  }
  Matrix<Unknowns> out = variance_ * (between + between.transpose());
  for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
    const Term &term = terms_[i];
    const auto jacobian = term.jacobian.head<Unknowns>();
    out += term.weight * term.weight * (variance_ + term.own) * jacobian * jacobian.transpose();
  }
  return scale_ * scale_ * out;
}

template void SurfaceTerms::add_to<SurfaceTerms::kPose>(Matrix<kPose> &, Vector<kPose> &) const noexcept;
template void SurfaceTerms::add_to<SurfaceTerms::kWithExcess>(Matrix<kWithExcess> &,
                                                              Vector<kWithExcess> &) const noexcept;
template SurfaceTerms::Matrix<SurfaceTerms::kPose>
SurfaceTerms::gradient_covariance<SurfaceTerms::kPose>() const noexcept;
template SurfaceTerms::Matrix<SurfaceTerms::kWithExcess>
SurfaceTerms::gradient_covariance<SurfaceTerms::kWithExcess>() const noexcept;

int SurfaceTerms::left_out() const noexcept {
  const auto end = terms_.begin() + count_;
  return static_cast<int>(std::count_if(terms_.begin(), end, [](const Term &t) { return t.robust == 0.0; }));
}

double SurfaceTerms::rms_mm() const noexcept {
  double squares = 0.0;
  int used = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
    if (terms_[i].robust > 0.0) {
      squares += terms_[i].residual * terms_[i].residual;
      ++used;
    }
  }
  return used > 0 ? std::sqrt(squares / used) : 0.0;
}

double SurfaceTerms::effective() const noexcept {
  double sum = 0.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
    sum += terms_[i].robust / correlation_sum_[i];
  }
  return sum;
}

} // namespace bregma::registration
