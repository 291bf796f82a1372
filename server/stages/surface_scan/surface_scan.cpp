#include "server/stages/surface_scan/surface_scan.hpp"

#include <algorithm>
#include <cmath>

#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

constexpr std::int64_t kMaxGapPeriods = 3;      // between two flanges, and between two readings of a window
constexpr std::int64_t kMinGap_ns = 20'000'000; // a shorter one is not a gap
constexpr double kJumpScatter_mm = 1.0;

std::int64_t max_gap_ns(std::int64_t period_ns) { return std::max(kMaxGapPeriods * period_ns, kMinGap_ns); }

} // namespace

void SurfaceScan::request(const ScanRequest &request) {
  if (!request.on) {
    request_.on = false;
    waiting_.clear();
    interruption_ = Interruption::kNone;
    return;
  }
  request_ = request;
  filter_.emplace(range::WindowOptions{range::WindowKind::kHampel,
                                       static_cast<std::size_t>(std::max<std::int64_t>(request.window, 1)), 3.0,
                                       request.delay_ns});
  beam_.beam = {vector_of(request.origin_mm), vector_of(request.direction)};
  beam_.covariance = matrix_of(request.beam_covariance);
  exact_.beam = beam_.beam;
  flanges_.clear();
  waiting_.clear();
  sigma_sum_mm_ = 0.0;
  since_value_ = valid_ = 0;
  last_reading_ns_ = placed_ns_ = 0;
  arm_.reset();
  sensor_.reset();
  last_point_mm_.reset();
  interruption_ = Interruption::kNone;
  counts_ = {};
}

void SurfaceScan::add(const FlangeSample &sample) {
  if (!request_.on || interruption_ != Interruption::kNone || !same(sample.device, request_.arm)) {
    return;
  }
  if (arm_ && *arm_ != sample.incarnation) {
    interruption_ = Interruption::kArmReplaced;
    return;
  }
  arm_ = sample.incarnation;
  if (!sample.measured_anew) {
    return; // no new measurement: the pose of an arm that is frozen holds at no other time
  }
  Flange flange{sample.acquired_ns, sample.age_sigma_ns, sample.period_ns,
                wire::from_wire<frame::RobotBase, frame::RobotFlange>(sample.T_base_flange)};
  std::copy(std::begin(sample.covariance), std::end(sample.covariance), flange.covariance);
  if (!flanges_.empty()) {
    const Flange &last = flanges_.back();
    const double elapsed_s = 1e-9 * static_cast<double>(flange.time_ns - last.time_ns);
    const double moved_mm = (flange.T_base_flange.translation() - last.T_base_flange.translation()).norm();
    if (moved_mm > kMaxFlangeSpeed_mm_s * elapsed_s + kJumpScatter_mm) {
      interruption_ = Interruption::kArmJumped;
      return;
    }
  }
  flanges_.push_back(flange);
  if (flanges_.size() > kMaxFlanges) {
    flanges_.pop_front();
  }
}

bool SurfaceScan::in_range(double range_mm) const {
  return range_mm >= request_.near_mm && range_mm <= request_.far_mm;
}

void SurfaceScan::add(const RangeReading &reading, std::int64_t now_ns) {
  if (!request_.on || interruption_ != Interruption::kNone || !same(reading.device, request_.sensor)) {
    return;
  }
  if (sensor_ && *sensor_ != reading.incarnation) {
    interruption_ = Interruption::kSensorReplaced;
    return;
  }
  sensor_ = reading.incarnation;
  placed_ns_ = placed_ns_ == 0 ? now_ns : placed_ns_;
  ++counts_.readings;
  const bool missing = !std::isfinite(reading.range_mm);
  const bool outside = !missing && !in_range(reading.range_mm);
  counts_.missing += missing ? 1 : 0;
  counts_.out_of_range += outside ? 1 : 0;
  if (last_reading_ns_ != 0 && reading.acquired_ns - last_reading_ns_ > max_gap_ns(reading.period_ns)) {
    filter_->reset(); // a window does not reach over a gap
    sigma_sum_mm_ = 0.0;
    since_value_ = valid_ = 0;
  }
  last_reading_ns_ = reading.acquired_ns;
  const bool valid = !missing && !outside;
  if (valid) {
    sigma_sum_mm_ += std::isfinite(reading.sigma_mm) ? reading.sigma_mm : 0.0;
    ++valid_;
  }
  ++since_value_;
  filter_->add({reading.acquired_ns, valid ? reading.range_mm : wire::kUnknown});
  if (since_value_ < request_.window || valid_ == 0) {
    return;
  }
  const auto filtered = filter_->value();
  if (!filtered) {
    return;
  }
  const double sigma_mm = request_.sigma_mm > 0.0 ? request_.sigma_mm : sigma_sum_mm_ / static_cast<double>(valid_);
  sigma_sum_mm_ = 0.0;
  since_value_ = valid_ = 0;
  if (waiting_.size() == kMaxWaiting) {
    ++counts_.overflown;
    waiting_.pop_front();
  }
  waiting_.push_back({reading.frame, filtered->time_ns, filtered->value, sigma_mm});
}

std::optional<SurfaceScan::Pair> SurfaceScan::around(std::int64_t time_ns) const {
  const auto after = std::lower_bound(flanges_.begin(), flanges_.end(), time_ns,
                                      [](const Flange &flange, std::int64_t time) { return flange.time_ns < time; });
  if (after == flanges_.end() || after == flanges_.begin()) {
    return std::nullopt;
  }
  return Pair{&*(after - 1), &*after};
}

SurfaceScan::Point SurfaceScan::point_of(const Value &value, const Pair &flanges) const {
  const Flange &a = *flanges.before;
  const Flange &b = *flanges.after;
  const auto whole_ns = static_cast<double>(b.time_ns - a.time_ns);
  const double fraction = static_cast<double>(value.time_ns - a.time_ns) / whole_ns;
  const calibration::BeamFlange T(a.T_base_flange.rotation().slerp(fraction, b.T_base_flange.rotation()),
                                  (1.0 - fraction) * a.T_base_flange.translation() +
                                      fraction * b.T_base_flange.translation());
  double range_mm = value.range_mm;
  double slope = 1.0;
  double curve_variance_mm2 = 0.0;
  if (request_.curved) {
    range_mm = request_.curve_scale_mm * std::pow(value.range_mm, request_.curve_exponent);
    slope = request_.curve_exponent * range_mm / value.range_mm;
    const Eigen::Vector2d J(range_mm / request_.curve_scale_mm, range_mm * std::log(value.range_mm));
    curve_variance_mm2 = J.dot(Eigen::Matrix2d::Map(request_.curve_covariance.data()) * J) +
                         request_.curve_rms_mm * request_.curve_rms_mm;
  }
  Point out;
  out.frame = value.frame;
  out.time_ns = value.time_ns;
  out.position_mm = calibration::beam_point(beam_.beam, {T, range_mm});
  const Vector3d from = calibration::beam_point(beam_.beam, {a.T_base_flange, range_mm});
  const Vector3d to = calibration::beam_point(beam_.beam, {b.T_base_flange, range_mm});
  const Vector3d path_of_a_sigma = static_cast<double>(b.sigma_ns) / whole_ns * (to - from);
  const Matrix6d flange = flange_covariance(b.covariance, T.translation(), options_);
  out.independent_mm2 = calibration::beam_point_covariance(exact_, {T, range_mm}, slope * value.sigma_mm, 0.0) +
                        uncertainty::tre_covariance(flange, out.position_mm) +
                        path_of_a_sigma * path_of_a_sigma.transpose();
  out.common_mm2 =
      calibration::beam_point_covariance(beam_, {T, range_mm}, std::sqrt(std::max(curve_variance_mm2, 0.0)), 0.0);
  return out;
}

std::optional<SurfaceScan::Point> SurfaceScan::next(std::int64_t now_ns) {
  while (request_.on && !waiting_.empty()) {
    const Value value = waiting_.front();
    const auto flanges = around(value.time_ns);
    const bool pending = flanges_.empty() || flanges_.back().time_ns < value.time_ns;
    if (!flanges && pending && now_ns - value.time_ns < kWait_ns) {
      return std::nullopt; // its flange may still come
    }
    waiting_.pop_front();
    if (!flanges || flanges->after->time_ns - flanges->before->time_ns > max_gap_ns(flanges->after->period_ns)) {
      ++counts_.without_flange;
      continue;
    }
    ++counts_.placed;
    placed_ns_ = now_ns;
    const Point point = point_of(value, *flanges);
    if (!point.position_mm.allFinite() || !point.independent_mm2.allFinite() || !point.common_mm2.allFinite()) {
      ++counts_.without_flange;
      continue;
    }
    if (!last_point_mm_ || (point.position_mm - *last_point_mm_).norm() >= request_.spacing_mm) {
      last_point_mm_ = point.position_mm;
      return point;
    }
  }
  return std::nullopt;
}

} // namespace bregma::server
