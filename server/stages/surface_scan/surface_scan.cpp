#include "server/stages/surface_scan/surface_scan.hpp"

#include <algorithm>
#include <cmath>

#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

using geometry::frame::Reference;
using geometry::frame::RobotBase;
using geometry::frame::RobotFlange;
using geometry::frame::Tracker;

constexpr double kJumpScatter_mm = 1.0;

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
  across_ = beam_.beam.direction.unitOrthogonal();
  curve_ = {{request.curve_scale_mm, request.curve_exponent}, {}};
  for (std::size_t i = 0; i < std::min<std::size_t>(request.curve_points, kMaxCurvePoints); ++i) {
    curve_.corrections.push_back({request.curve_corrections[i].reading, request.curve_corrections[i].add_mm});
  }
  if (request.beside_tracker) {
    T_tracker_base_ = geometry::inverse(geometry::UncertainPose<RobotBase, Tracker>{
        wire::from_wire<RobotBase, Tracker>(request.T_base_tracker), matrix_of(request.tracker_covariance)});
  }
  flanges_.clear();
  references_.clear();
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
  const auto T = wire::from_wire<RobotBase, RobotFlange>(sample.T_base_flange);
  if (const Flanges::Sample *last = flanges_.newest()) {
    const double elapsed_s = 1e-9 * static_cast<double>(sample.acquired_ns - last->time_ns);
    const double moved_mm = (T.translation() - last->T.pose.translation()).norm();
    if (moved_mm > kMaxFlangeSpeed_mm_s * elapsed_s + kJumpScatter_mm) {
      interruption_ = Interruption::kArmJumped;
      return;
    }
  }
  flanges_.add({sample.acquired_ns,
                sample.age_sigma_ns,
                sample.period_ns,
                {T, flange_covariance(sample.covariance, T.translation(), options_)}});
}

void SurfaceScan::add(const ReferenceSample &sample) {
  if (request_.on && request_.beside_tracker) {
    references_.add(
        {sample.acquired_ns,
         sample.age_sigma_ns,
         sample.period_ns,
         {wire::from_wire<Tracker, Reference>(sample.T_tracker_reference), RowMajor<6>::Map(sample.covariance)}});
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

bool SurfaceScan::settled(std::int64_t time_ns) const {
  return flanges_.reaches(time_ns) && (!request_.beside_tracker || references_.reaches(time_ns));
}

SurfaceScan::Point SurfaceScan::point_of(const Value &value, const Flanges::Pose &T_base_flange) const {
  const calibration::BeamFlange &T = T_base_flange.pose;
  double range_mm = value.range_mm;
  double slope = 1.0;
  double curve_variance_mm2 = 0.0;
  if (request_.curved) {
    const double by_law_mm = curve_.law.distance_mm(value.range_mm);
    range_mm = curve_.distance_mm(value.range_mm);
    slope = curve_.law.exponent * by_law_mm / value.range_mm;
    const Eigen::Vector2d J(by_law_mm / curve_.law.scale_mm, by_law_mm * std::log(value.range_mm));
    curve_variance_mm2 = J.dot(Eigen::Matrix2d::Map(request_.curve_covariance.data()) * J) +
                         request_.curve_rms_mm * request_.curve_rms_mm;
  }
  Point out;
  out.frame = value.frame;
  out.time_ns = value.time_ns;
  out.position_mm = calibration::beam_point(beam_.beam, {T, range_mm});
  out.independent_mm2 = calibration::beam_point_covariance(exact_, {T, range_mm}, slope * value.sigma_mm, 0.0) +
                        uncertainty::tre_covariance(T_base_flange.covariance, out.position_mm);
  out.common_mm2 =
      calibration::beam_point_covariance(beam_, {T, range_mm}, std::sqrt(std::max(curve_variance_mm2, 0.0)), 0.0);
  out.towards_sensor = -(T.rotation() * beam_.beam.direction);
  out.across = T.rotation() * across_;
  return out;
}

SurfaceScan::Point SurfaceScan::in_reference(const Point &in_base, const References::Pose &T_tracker_reference) const {
  const auto T_reference_tracker = geometry::inverse(T_tracker_reference);
  const geometry::UncertainPose<Reference, Tracker> exact{T_reference_tracker.pose, Matrix6d::Zero()};
  const auto T_reference_base = exact * T_tracker_base_;
  Point out = in_base;
  out.position_mm = T_reference_base.pose * in_base.position_mm;
  const Matrix3d R = T_reference_base.pose.rotation_matrix();
  out.independent_mm2 = R * in_base.independent_mm2 * R.transpose() +
                        uncertainty::tre_covariance(T_reference_tracker.covariance, out.position_mm);
  out.common_mm2 = R * in_base.common_mm2 * R.transpose() +
                   uncertainty::tre_covariance(T_reference_base.covariance, out.position_mm);
  out.towards_sensor = R * in_base.towards_sensor;
  out.across = R * in_base.across;
  return out;
}

std::optional<SurfaceScan::Point> SurfaceScan::next(std::int64_t now_ns) {
  while (request_.on && !waiting_.empty()) {
    const Value value = waiting_.front();
    if (!settled(value.time_ns) && now_ns - value.time_ns < kWait_ns) {
      return std::nullopt; // what is missing may still come
    }
    waiting_.pop_front();
    const auto flange = flanges_.at(value.time_ns);
    const auto reference = references_.at(value.time_ns);
    counts_.without_flange += flange ? 0 : 1;
    counts_.without_reference += flange && request_.beside_tracker && !reference ? 1 : 0;
    if (!flange || (request_.beside_tracker && !reference)) {
      continue;
    }
    Point point = point_of(value, *flange);
    if (request_.beside_tracker) {
      point = in_reference(point, *reference);
    }
    if (!point.position_mm.allFinite() || !point.independent_mm2.allFinite() || !point.common_mm2.allFinite()) {
      ++counts_.without_flange;
      continue;
    }
    ++counts_.placed;
    placed_ns_ = now_ns;
    if (!last_point_mm_ || (point.position_mm - *last_point_mm_).norm() >= request_.spacing_mm) {
      last_point_mm_ = point.position_mm;
      return point;
    }
  }
  return std::nullopt;
}

} // namespace bregma::server
