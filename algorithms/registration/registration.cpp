#include "algorithms/registration/registration.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/registration/points/robust_points.hpp"
#include "algorithms/registration/surface/surface_terms.hpp"
#include "algorithms/registration/surface/tilt_excess.hpp"
#include "algorithms/registration/twist.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"

namespace bregma::registration {

using geometry::Matrix36d;
using geometry::Vector6d;

namespace {

constexpr double kSettledStep_mm = 1e-4; // an estimate that moves less has converged
constexpr double kLever_mm = 80.0;       // lever that scales rotations against translations
constexpr int kRescaled = 6;             // iterations that may change the noise scale
constexpr double kSlow = 0.5;            // a step that shrank less is shortened: the surface is curved within it
constexpr double kNamingAlarm = 0.05;    // probability of naming a good fiducial in addition to a wrong one
constexpr double kWarmLimit_mm = 10.0;   // a start farther from the fiducials' own fit is not used

double motion_mm(const Vector6d &twist) { return kLever_mm * twist.head<3>().norm() + twist.tail<3>().norm(); }

double distance_mm(const ImageFromReference &a, const ImageFromReference &b, const Vector3d &at) {
  return kLever_mm * geometry::angle_between(a.rotation(), b.rotation()) + (a * at - b * at).norm();
}

} // namespace

struct RegistrationEstimator::Workspace {
  Workspace(const surface::SurfaceModel *surface_in, const RegistrationOptions &options_in, int max_surface_samples)
      : options(options_in), surface(surface_in), terms(surface_in, options_in, max_surface_samples) {}

  [[nodiscard]] std::span<const PointPair> used_pairs() const {
    return {pairs.data(), static_cast<std::size_t>(result.fiducial_count)};
  }

  void take(std::span<const FiducialObservation> fiducials);
  [[nodiscard]] bool geometry_allows();
  [[nodiscard]] Refusal test_consistency(const PairedFit &fit);
  void name_suspect(int index);
  [[nodiscard]] bool fit_jointly(const ImageFromReference &start);
  template <int Unknowns> [[nodiscard]] bool fit(const ImageFromReference &start);
  void report_residuals();
  void find_weakest(std::span<const Vector3d> targets_image_mm);
  // Residuals, accuracy and whether it suffices, once fit_jointly has succeeded.
  void finish(std::span<const Vector3d> targets_image_mm);

  RegistrationOptions options;
  const surface::SurfaceModel *surface;
  SurfaceTerms terms;
  std::array<PointPair, kMaxFiducials> pairs; // source: Reference, target: Image
  Vector3d centre = Vector3d::Zero();         // centroid of the fiducials in Image: centre of the iteration's rotations
  Matrix6d normal_inverse = Matrix6d::Zero();
  RegistrationResult result;
};

void RegistrationEstimator::Workspace::take(std::span<const FiducialObservation> fiducials) {
  result = RegistrationResult{};
  result.fiducial_count = static_cast<int>(std::min<std::size_t>(fiducials.size(), kMaxFiducials));
  centre.setZero();
  for (int i = 0; i < result.fiducial_count; ++i) {
    const FiducialObservation &f = fiducials[static_cast<std::size_t>(i)];
    pairs[static_cast<std::size_t>(i)] = {f.reference_mm, f.image_mm, f.reference_covariance, f.image_covariance};
    centre += f.image_mm / result.fiducial_count;
  }
  if (result.fiducial_count == 0 && surface != nullptr) {
    centre = surface->centre_mm();
  }
}

// At least three fiducials that are not on a line, on both sides.
bool RegistrationEstimator::Workspace::geometry_allows() {
  if (result.fiducial_count < 3) {
    result.refusal = Refusal::kTooFewFiducials;
    return false;
  }
  std::array<Vector3d, kMaxFiducials> points;
  const auto spread_of = [&](auto member) {
    const auto used = used_pairs();
    std::transform(used.begin(), used.end(), points.begin(), [member](const PointPair &p) { return p.*member; });
    return spread_mm({points.data(), used.size()})[1];
  };
  result.spread_mm = std::min(spread_of(&PointPair::source_mm), spread_of(&PointPair::target_mm));
  result.refusal = result.spread_mm < options.min_spread_mm ? Refusal::kCollinearFiducials : Refusal::kNone;
  return result.refusal == Refusal::kNone;
}

// Half of the allowed false refusals goes to the sum of all residuals, half to the largest of them (Bonferroni).
Refusal RegistrationEstimator::Workspace::test_consistency(const PairedFit &fit) {
  const double allowed = 0.5 * options.false_refusal;
  const int n = fit.count;
  bool consistent = fit.p_value >= allowed;
  for (int i = 0; i < n; ++i) {
    consistent = consistent && fit.fiducials[static_cast<std::size_t>(i)].p_value >= allowed / n;
  }
  if (consistent) {
    return Refusal::kNone;
  }
  if (n < 4) {
    return Refusal::kFreTooLarge; // three residuals cannot identify the wrong fiducial
  }
  const auto names = [this](const RobustFit &fit_of_rest) {
    return fit_of_rest.found && fit_of_rest.outliers > 0 && fit_of_rest.fit.p_value >= options.false_refusal;
  };
  RobustFit robust = fit_paired_robust(used_pairs(), {options.false_refusal});
  if (!names(robust)) { // a contradiction is certain here: a higher false-alarm rate may identify it
    robust = fit_paired_robust(used_pairs(), {kNamingAlarm});
  }
  if (!names(robust)) {
    return Refusal::kFreTooLarge;
  }
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    result.fiducials[k].leave_one_out_mm = robust.fit.fiducials[k].leave_one_out_mm;
    result.fiducials[k].p_value = robust.p_value[k];
    if (!robust.inlier[k]) {
      name_suspect(i);
    }
  }
  return Refusal::kContradictingFiducial;
}

void RegistrationEstimator::Workspace::name_suspect(int index) {
  const auto chance = [this](int i) { return result.fiducials[static_cast<std::size_t>(i)].p_value; };
  result.suspects[static_cast<std::size_t>(index)] = true;
  ++result.suspect_count;
  if (result.suspect < 0 || chance(index) < chance(result.suspect)) {
    result.suspect = index;
  }
}

bool RegistrationEstimator::Workspace::fit_jointly(const ImageFromReference &start) {
  result.beam_count = terms.beam_count();
  const bool with_excess = result.beam_count > 0 && options.excess_sigma_mm > 0.0;
  return with_excess ? fit<SurfaceTerms::kWithExcess>(start) : fit<SurfaceTerms::kPose>(start);
}

// Unknowns: the pose, or the pose and the excess on tilted skin.
template <int Unknowns> bool RegistrationEstimator::Workspace::fit(const ImageFromReference &start) {
  using Matrix = SurfaceTerms::Matrix<Unknowns>;
  using Vector = SurfaceTerms::Vector<Unknowns>;
  constexpr bool kExcess = Unknowns == SurfaceTerms::kWithExcess;
  const Vector3d excess_information =
      Vector3d(1.0, kExcessSlopes, kExcessSlopes).cwiseAbs2().cwiseInverse() / std::pow(options.excess_sigma_mm, 2);
  ImageFromReference T = start;
  Vector3d excess = Vector3d::Zero();
  bool settled = false;
  double last_motion = std::numeric_limits<double>::infinity();
  while (!settled && result.iterations < options.max_iterations) {
    Matrix without_skin = Matrix::Zero(); // fiducials, and what is known of the excess
    Vector gradient = Vector::Zero();
    const Matrix3d R = T.rotation_matrix();
    for (const PointPair &pair : used_pairs()) {
      const Eigen::LLT<Matrix3d> S(R * pair.source_covariance * R.transpose() + pair.target_covariance);
      const Vector3d mapped = T * pair.source_mm;
      const Matrix36d J = geometry::point_jacobian(mapped - centre);
      const Matrix36d WJ = S.solve(J);
      without_skin.template topLeftCorner<6, 6>() += J.transpose() * WJ;
      gradient.template head<6>() += WJ.transpose() * (mapped - pair.target_mm);
    }
    if constexpr (kExcess) {
      without_skin.diagonal().template tail<3>() = excess_information;
      gradient.template tail<3>() = excess_information.cwiseProduct(excess);
    }
    terms.linearise(T, centre, excess, result.iterations < kRescaled);
    Matrix normal = without_skin;
    terms.add_to<Unknowns>(normal, gradient);

    const Eigen::LDLT<Matrix> solver(normal);
    Vector step = -solver.solve(gradient);
    if (solver.info() != Eigen::Success || !step.allFinite()) {
      return false;
    }
    double motion = motion_mm(step.template head<6>());
    if constexpr (kExcess) {
      motion = std::max(motion, step.template tail<3>().norm());
    }
    settled = motion < kSettledStep_mm;
    ++result.iterations;
    if (!settled) {
      if (result.iterations > kRescaled && motion > kSlow * last_motion) {
        step *= 0.5;
      }
      last_motion = motion;
      T = moved_about(centre, Vector6d(step.template head<6>()), T);
      if constexpr (kExcess) {
        excess += step.template tail<3>();
      }
      continue;
    }
    // The covariance is that of the last linearisation; the last step does not justify another iteration.
    const Matrix inverse = solver.solve(Matrix::Identity());
    const Matrix of_gradient = without_skin + terms.gradient_covariance<Unknowns>();
    const Matrix covariance = inverse * of_gradient * inverse;
    normal_inverse = covariance_at_origin(inverse.template topLeftCorner<6, 6>(), centre);
    result.covariance = covariance_at_origin(covariance.template topLeftCorner<6, 6>(), centre);
    result.T_image_reference = T;
    if constexpr (kExcess) {
      result.excess_mm = excess;
      result.excess_sigma_mm = std::sqrt(covariance(6, 6));
    }
  }
  return settled;
}

void RegistrationEstimator::Workspace::report_residuals() {
  const auto T = result.T_image_reference.as<geometry::frame::Target, geometry::frame::Source>();
  double squares = 0.0;
  double expected = 0.0;
  for (int i = 0; i < result.fiducial_count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    result.fiducials[k] = assess_fiducial(pairs[k], T, result.covariance, normal_inverse, result.fiducial_count >= 4);
    squares += result.fiducials[k].residual_mm.squaredNorm();
    expected += result.fiducials[k].expected_squared_mm2;
  }
  result.fre_mm = std::sqrt(squares / result.fiducial_count);
  result.fre_expected_mm = std::sqrt(std::max(expected, 0.0) / result.fiducial_count);
  result.surface_count = terms.count();
  result.surface_left_out = terms.left_out();
  result.surface_rms_mm = terms.rms_mm();
  result.surface_scale = terms.scale();
  result.surface_effective = terms.effective();
}

// The principal motion of the pose's error, about the head's centre, that moves the worst target most.
void RegistrationEstimator::Workspace::find_weakest(std::span<const Vector3d> targets_image_mm) {
  const Vector3d head = surface != nullptr ? surface->centre_mm() : centre;
  // Without targets: six points inside the head are used.
  constexpr double kInside_mm = 60.0;
  std::array<Vector3d, 6> stand_in;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector3d inside = kInside_mm * Vector3d::Unit(static_cast<Eigen::Index>(k));
    stand_in[2 * k] = head + inside;
    stand_in[2 * k + 1] = head - inside;
  }
  const bool given = !targets_image_mm.empty();
  const std::span<const Vector3d> points = given ? targets_image_mm : std::span<const Vector3d>(stand_in);
  std::size_t worst = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double tre = uncertainty::rms_mm(uncertainty::tre_covariance(result.covariance, points[i]));
    if (i == 0 || tre > result.worst_target_tre_mm) {
      result.worst_target_tre_mm = tre;
      worst = i;
    }
  }
  result.worst_target = given ? static_cast<int>(worst) : -1;

  Vector6d lever;
  lever << Vector3d::Constant(kLever_mm), Vector3d::Ones();
  const Matrix6d about_head = covariance_at_origin(result.covariance, -head);
  const Matrix6d scaled = lever.asDiagonal() * about_head * lever.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(scaled);
  const Matrix36d J = geometry::point_jacobian(points[worst] - head);
  double largest = -1.0;
  for (int k = 0; k < 6; ++k) {
    const Vector6d direction = solver.eigenvectors().col(k);
    const Vector6d twist = direction.cwiseQuotient(lever);
    const double share = solver.eigenvalues()[k] * (J * twist).squaredNorm();
    if (share > largest) {
      largest = share;
      result.weakest = direction;
      result.weakest_sigma_mm = std::sqrt(std::max(solver.eigenvalues()[k], 0.0));
    }
  }
}

void RegistrationEstimator::Workspace::finish(std::span<const Vector3d> targets_image_mm) {
  result.has_estimate = true;
  report_residuals();
  find_weakest(targets_image_mm);
  const bool sufficient = result.worst_target_tre_mm <= options.max_target_tre_mm;
  result.refusal = sufficient ? Refusal::kNone : Refusal::kDirectionNotFixed;
}

RegistrationEstimator::RegistrationEstimator(const surface::SurfaceModel *surface, const RegistrationOptions &options,
                                             int max_surface_samples)
    : workspace_(std::make_unique<Workspace>(surface, options, max_surface_samples)) {}
RegistrationEstimator::~RegistrationEstimator() = default;
RegistrationEstimator::RegistrationEstimator(RegistrationEstimator &&) noexcept = default;
RegistrationEstimator &RegistrationEstimator::operator=(RegistrationEstimator &&) noexcept = default;

const RegistrationOptions &RegistrationEstimator::options() const noexcept { return workspace_->options; }

const RegistrationResult &RegistrationEstimator::estimate(std::span<const FiducialObservation> fiducials,
                                                          std::span<const SurfaceSample> samples,
                                                          std::span<const Vector3d> targets_image_mm,
                                                          const ImageFromReference *start) noexcept {
  Workspace &w = *workspace_;
  RegistrationResult &result = w.result;
  w.take(fiducials);
  if (!w.geometry_allows()) {
    return result;
  }
  const PairedFit fit = fit_paired(w.used_pairs());
  result.chi_square = fit.chi_square;
  result.p_value = fit.p_value;
  const auto T_fit = fit.T_target_source.as<geometry::frame::Image, geometry::frame::Reference>();
  w.terms.set_samples(samples);
  const bool warm = start != nullptr && distance_mm(*start, T_fit, w.pairs.front().source_mm) < kWarmLimit_mm;
  if (!fit.converged || !w.fit_jointly(warm ? *start : T_fit)) {
    result.refusal = Refusal::kNotConverged;
    return result;
  }
  w.finish(targets_image_mm);
  if (const Refusal inconsistent = w.test_consistency(fit); inconsistent != Refusal::kNone) {
    result.refusal = inconsistent;
  }
  return result;
}

const RegistrationResult &RegistrationEstimator::estimate_located(std::span<const FiducialObservation> fiducials,
                                                                  std::span<const SurfaceSample> samples,
                                                                  std::span<const Vector3d> targets_image_mm,
                                                                  const ImageFromReference &located) noexcept {
  Workspace &w = *workspace_;
  RegistrationResult &result = w.result;
  w.take(fiducials);
  result.chi_square = result.p_value = geometry::kUnknown;
  w.terms.set_samples(samples);
  if (!w.fit_jointly(located)) {
    result.refusal = Refusal::kNotConverged;
    return result;
  }
  w.finish(targets_image_mm);
  // The few fiducials cannot be compared with each other, but with the surface's pose.
  for (int i = 0; i < result.fiducial_count; ++i) {
    if (result.fiducials[static_cast<std::size_t>(i)].p_value < w.options.false_refusal / result.fiducial_count) {
      w.name_suspect(i);
      result.refusal = Refusal::kContradictingFiducial;
    }
  }
  return result;
}

} // namespace bregma::registration
