#include "idl/validity.hpp"

#include <cmath>

#include <Eigen/Eigenvalues>

namespace bregma::wire {
namespace {

using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr double kRadius95 = 2.7954834829151074; // root of the 95 % quantile of chi-square, three degrees of freedom

constexpr std::int64_t kMaxStated_ns =
    1'000'000'000'000'000'000; // 31 years: larger times are nonsense, and would overflow

std::int64_t risen_ns(std::int64_t elapsed_ns) noexcept {
  return static_cast<std::int64_t>(static_cast<double>(elapsed_ns) * TransitClock::kMaxDrift);
}

template <std::size_t N> bool all_finite(const double (&values)[N]) noexcept {
  return std::all_of(std::begin(values), std::end(values), [](double value) { return std::isfinite(value); });
}

} // namespace

std::optional<std::int64_t> TransitClock::arrived(const BootId &boot_id, std::int64_t published_boot_ns,
                                                  std::int64_t arrival_boot_ns) noexcept {
  std::array<std::uint8_t, 16> publisher{};
  std::copy(std::begin(boot_id), std::end(boot_id), publisher.begin());
  if (published_boot_ns <= 0 || published_boot_ns > kMaxStated_ns || publisher == std::array<std::uint8_t, 16>{}) {
    return std::nullopt;
  }
  const std::int64_t difference_ns = arrival_boot_ns - published_boot_ns;
  if (publisher == own_) {
    return difference_ns >= 0 ? std::optional(difference_ns) : std::nullopt;
  }
  const std::int64_t pause_ns = arrival_boot_ns - last_arrival_ns_;
  if (publisher != publisher_ || pause_ns > kForgotten_ns) {
    publisher_ = publisher;
    offset_ns_.reset();
    settled_ = false;
  }
  if (!offset_ns_ || pause_ns > kSettling_ns) {
    flowing_since_ns_ = arrival_boot_ns;
  }
  last_arrival_ns_ = arrival_boot_ns;
  settled_ = settled_ || arrival_boot_ns - flowing_since_ns_ >= kSettling_ns;
  const std::int64_t envelope_ns = offset_ns_ ? *offset_ns_ + risen_ns(arrival_boot_ns - offset_at_ns_) : difference_ns;
  if (!offset_ns_ || difference_ns <= envelope_ns) {
    offset_ns_ = difference_ns;
    offset_at_ns_ = arrival_boot_ns;
  }
  return settled_ ? std::optional(std::max<std::int64_t>(0, difference_ns - envelope_ns)) : std::nullopt;
}

bool has_pose(const NavigationState &state) noexcept {
  const bool shown = state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED;
  // Any other value counts as refused, one that is not known here too.
  const bool plausible = state.plausibility == bregma_wire_PLAUSIBILITY_UNKNOWN ||
                         state.plausibility == bregma_wire_PLAUSIBILITY_GOOD ||
                         state.plausibility == bregma_wire_PLAUSIBILITY_INFLATED;
  return shown && plausible && all_finite(state.T_image_tip.rotation_wxyz) &&
         all_finite(state.T_image_tip.translation_mm) && std::isfinite(state.tre_rms_mm) &&
         all_finite(state.tre_95.semi_axes_mm);
}

std::optional<std::int64_t> since_published_ns(const Arrival &arrival, std::int64_t now_boot_ns) noexcept {
  if (!arrival.transit_ns || now_boot_ns < arrival.boot_ns) {
    return std::nullopt;
  }
  return *arrival.transit_ns + (now_boot_ns - arrival.boot_ns);
}

std::optional<std::int64_t> age_ns(const NavigationState &state, const Arrival &arrival,
                                   std::int64_t now_boot_ns) noexcept {
  const auto since_ns = since_published_ns(arrival, now_boot_ns);
  if (!since_ns || state.acquired_time_ns <= 0 || state.age_ns < 0 || state.age_ns > kMaxStated_ns) {
    return std::nullopt;
  }
  return state.age_ns + *since_ns;
}

std::int64_t remaining_ns(const NavigationState &state, const Arrival &arrival, std::int64_t now_boot_ns) noexcept {
  const auto now_age_ns = age_ns(state, arrival, now_boot_ns);
  if (!has_pose(state) || !now_age_ns || state.valid_for_ns < 0) {
    return 0;
  }
  const std::int64_t stated_ns =
      state.valid_for_ns != 0 ? state.valid_for_ns : live_limit_ns(kLiveLimit_ms, 0) - state.age_ns;
  const std::int64_t since_ns = *now_age_ns - state.age_ns;
  return std::max<std::int64_t>(0, std::min(stated_ns - since_ns, kMaxLiveAge_ns - *now_age_ns));
}

TipError tip_error(const NavigationState &state, std::int64_t since_published_ns) noexcept {
  TipError out{state.tre_95, state.tre_rms_mm};
  const double dt_s = static_cast<double>(since_published_ns) * 1e-9;
  const double a = state.acceleration_sigma_mm_s2;
  const bool grows = all_finite(state.position_velocity_covariance_mm2_s) &&
                     all_finite(state.velocity_covariance_mm2_s2) && std::isfinite(a);
  if (!grows || !(dt_s > 0.0) || !all_finite(state.tre_95.semi_axes_mm) || !all_finite(state.tre_95.axes)) {
    return out;
  }
  // P is the covariance that the published region belongs to.
  const Eigen::Map<const Matrix3> axes(state.tre_95.axes);
  const Eigen::Vector3d sigma = Eigen::Map<const Eigen::Vector3d>(state.tre_95.semi_axes_mm) / kRadius95;
  const Eigen::Map<const Matrix3> C(state.position_velocity_covariance_mm2_s);
  const Eigen::Map<const Matrix3> V(state.velocity_covariance_mm2_s2);
  const Eigen::Matrix3d P = axes.transpose() * sigma.cwiseAbs2().asDiagonal() * axes;
  const double dt2 = dt_s * dt_s;
  const Eigen::Matrix3d grown =
      P + dt_s * (C + C.transpose()) + dt2 * V + 0.25 * dt2 * dt2 * a * a * Eigen::Matrix3d::Identity();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(0.5 * (grown + grown.transpose())); // smallest first
  for (int i = 0; i < 3; ++i) {
    out.region_95.semi_axes_mm[i] = kRadius95 * std::sqrt(std::max(0.0, solver.eigenvalues()[2 - i]));
    Eigen::Map<Eigen::Vector3d>(out.region_95.axes + 3 * static_cast<std::ptrdiff_t>(i)) =
        solver.eigenvectors().col(2 - i);
  }
  out.rms_mm = std::sqrt(std::max(0.0, grown.trace()));
  return out;
}

} // namespace bregma::wire
