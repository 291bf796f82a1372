// What the navigation states contain: the pose at the time of publication, its accuracy, and its position relative to
// plan, prediction and critical structures.
#include <algorithm>
#include <cmath>

#include "algorithms/planning/trajectory_guidance.hpp"
#include "server/stages/navigation/pipeline.hpp"
#include "server/stages/schedules.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kPredictionAge_ns = 250'000'000;
constexpr double kSameTarget_mm = 0.01;    // tolerance between the end of a plan and its target
constexpr double kVelocityFilter_hz = 3.0; // for the velocity if the displayed position is not filtered

void put(const Judgement &judgement, wire::NavigationState &state) noexcept {
  state.plausibility = judgement.plausibility;
  state.plausibility_reason = judgement.reason;
  state.plausibility_statistic = judgement.statistic;
  state.plausibility_threshold = judgement.threshold;
}

bool is_shown(wire::PoseStatus status) noexcept {
  return status == bregma_wire_POSE_LIVE || status == bregma_wire_POSE_UNVERIFIED;
}

} // namespace

void NavigationPipeline::clear_pose(wire::NavigationState &state) noexcept {
  state.T_image_tip = wire::unknown_pose();
  put_unknown(state.velocity_mm_s);
  put_unknown(state.covariance);
  state.tre_rms_mm = wire::kUnknown;
  state.tre_95 = unknown_ellipsoid();
  state.distance_to_target_mm = state.lateral_deviation_mm = wire::kUnknown;
  state.angle_rad = state.remaining_depth_mm = wire::kUnknown;
  state.prediction = bregma_wire_DEFORMATION_NO_MODEL;
  put_unknown(state.predicted_target_mm);
  state.distance_to_predicted_target_mm = wire::kUnknown;
  (void)wire::set_name(state.nearest_structure, "");
  state.nearest_structure_mm = state.nearest_structure_sigma_mm = wire::kUnknown;
  put_unknown(state.position_velocity_covariance_mm2_s);
  put_unknown(state.velocity_covariance_mm2_s2);
  state.acceleration_sigma_mm_s2 = wire::kUnknown;
  state.valid_for_ns = 0;
  put(Judgement{}, state);
}

void NavigationPipeline::update_states(std::int64_t now_ns) noexcept {
  evaluated_ns_ = now_ns;
  ++updates_;
  if (const auto result = touch_.finish(now_ns)) {
    (void)events_.try_push(*result);
  }
  for (std::size_t i = 0; i < tool_count_; ++i) {
    publish(tools_[i], states_[i], now_ns);
  }
}

void NavigationPipeline::publish(Tool &tool, wire::NavigationState &state, std::int64_t now_ns) noexcept {
  state.frame = frame_;
  state.frame_sent_time_ns = frame_sent_ns_;
  state.acquired_time_ns = acquired_ns(tool);
  state.published_time_ns = now_ns;
  state.age_ns = any_frame_ ? now_ns - state.acquired_time_ns : 0;
  state.age_sigma_ns = exposure_.sigma_ns;
  state.status = status_of(tool, now_ns);
  state.session = session_.state;
  state.source_kind = !any_frame_ ? bregma_wire_DEVICE_UNKNOWN
                      : by_arm()  ? bregma_wire_DEVICE_ROBOT
                                  : bregma_wire_DEVICE_TRACKER;
  state.patient = by_arm() ? bregma_wire_PATIENT_NOT_TRACKED : bregma_wire_PATIENT_TRACKED;
  copy_name(state.source, source_);
  (void)wire::set_name(state.trajectory, tool.plan != nullptr ? std::string_view(tool.plan->name) : std::string_view());
  if (is_shown(state.status) && !fill_pose(tool, state)) {
    state.status = bregma_wire_POSE_IMPLAUSIBLE;
  }
  if (is_shown(state.status)) {
    state.valid_for_ns = stale_at_ns(tool) - now_ns;
  } else {
    tool.filter.reset();
    tool.turn_rate.reset();
    clear_pose(state);
  }
  const bool judged = (reference_.visible || reference_.malformed()) && (tool.body.visible || tool.body.malformed());
  put(judged ? judge_.judgement(index_of(tool)) : Judgement{}, state);
}

// The tip at the time of publication. The rotation is that of the frame. The position's error is that of the filter, or
// of the frame if configured; both errors grow with the age. The cross-covariance with the rotation is reduced by the
// filter's gain.
NavigationPipeline::MovingTip NavigationPipeline::moved(Tool &tool, const TipPose &T_reference_tip,
                                                        double age_s) const noexcept {
  // Conversion between perturbations about Reference's origin and about the tip.
  Matrix6d about_tip = Matrix6d::Identity();
  about_tip.bottomLeftCorner<3, 3>() = -geometry::skew(T_reference_tip.pose.translation());
  Matrix6d covariance = about_tip * T_reference_tip.covariance * about_tip.transpose();
  const bool filtered = parameters_.filter_hz > 0.0;
  tool.filter.add(T_reference_tip.pose.translation(), covariance.bottomRightCorner<3, 3>(), acquired_ns(tool),
                  filtered ? parameters_.filter_hz : kVelocityFilter_hz);
  const MovingPoint at_frame = filtered ? tool.filter.estimate() : tool.filter.unfiltered();
  MovingPoint tip = at_frame.after(age_s, parameters_.hand_acceleration_mm_s2);
  const Vector3d path_of_a_sigma = 1e-9 * static_cast<double>(exposure_.sigma_ns) * tip.velocity_mm_s;
  tip.P += path_of_a_sigma * path_of_a_sigma.transpose();

  tool.turn_rate.add(T_reference_tip.pose.rotation(), acquired_ns(tool));
  covariance.topLeftCorner<3, 3>() += tool.turn_rate.growth(age_s);
  covariance.bottomRightCorner<3, 3>() = tip.P;
  if (filtered) {
    covariance.topRightCorner<3, 3>() = (covariance.topRightCorner<3, 3>() * tool.filter.gain().transpose()).eval();
    covariance.bottomLeftCorner<3, 3>() = covariance.topRightCorner<3, 3>().transpose();
  }
  about_tip.bottomLeftCorner<3, 3>() = geometry::skew(tip.position_mm);
  return {{{T_reference_tip.pose.rotation(), tip.position_mm}, about_tip * covariance * about_tip.transpose()}, tip};
}

bool NavigationPipeline::fill_pose(Tool &tool, wire::NavigationState &state) noexcept {
  const double age_s = 1e-9 * static_cast<double>(std::max<std::int64_t>(state.age_ns, 0));
  MovingTip moving = moved(tool, tip_in_reference(tool), age_s);
  // The tip's calibration error, in the axes of Reference, affects only the tip's position.
  const Matrix3d R = moving.T_reference_tip.pose.rotation_matrix();
  moving.T_reference_tip.covariance.bottomRightCorner<3, 3>() += R * tool.tip_covariance * R.transpose();
  // That of the axis turns the tool about its tip: by the lever arm to Reference's origin it is an error there.
  Matrix6d axis_error = Matrix6d::Zero();
  axis_error.topLeftCorner<3, 3>().diagonal().setConstant(tool.model->axis_sigma_rad * tool.model->axis_sigma_rad);
  Matrix6d about_origin = Matrix6d::Identity();
  about_origin.bottomLeftCorner<3, 3>() = geometry::skew(moving.T_reference_tip.pose.translation());
  moving.T_reference_tip.covariance += about_origin * axis_error * about_origin.transpose();
  if (tool.carried) {
    moving.T_reference_tip.covariance += hand_eye_covariance();
  }
  const auto T_image_tip = *registration_ * moving.T_reference_tip;
  const Vector3d tip = T_image_tip.pose.translation();
  const Matrix3d position_covariance = uncertainty::tre_covariance(T_image_tip.covariance, tip);
  const Matrix3d R_image_reference = registration_->pose.rotation_matrix();
  const Vector3d velocity = R_image_reference * moving.tip.velocity_mm_s;
  const double tre_rms_mm = uncertainty::rms_mm(position_covariance);
  if (!tip.allFinite() || !T_image_tip.pose.rotation().coeffs().allFinite() || !T_image_tip.covariance.allFinite() ||
      !velocity.allFinite() || !std::isfinite(tre_rms_mm)) {
    return false;
  }
  state.T_image_tip = wire::to_wire(T_image_tip.pose);
  put(T_image_tip.covariance, state.covariance);
  state.tre_rms_mm = tre_rms_mm;
  state.tre_95 = to_wire(uncertainty::ellipsoid_95(position_covariance));
  put(velocity, state.velocity_mm_s);
  const auto in_image = [&](const Matrix3d &M) -> Matrix3d {
    return R_image_reference * M * R_image_reference.transpose();
  };
  put(in_image(moving.tip.C), state.position_velocity_covariance_mm2_s);
  put(Matrix3d(in_image(moving.tip.V) + velocity * velocity.transpose()), state.velocity_covariance_mm2_s2);
  state.acceleration_sigma_mm_s2 = parameters_.hand_acceleration_mm_s2;

  state.distance_to_target_mm = state.lateral_deviation_mm = wire::kUnknown;
  state.angle_rad = state.remaining_depth_mm = wire::kUnknown;
  if (tool.plan != nullptr) {
    const Vector3d axis = T_image_tip.pose.rotation() * tool.model->axis;
    const auto guidance = planning::guide({tool.plan->entry_mm, tool.plan->target_mm}, tip, axis);
    state.distance_to_target_mm = guidance.distance_to_target_mm;
    state.lateral_deviation_mm = guidance.lateral_deviation_mm;
    state.angle_rad = guidance.angle_rad;
    state.remaining_depth_mm = guidance.remaining_depth_mm;
  }
  fill_prediction(tool, state);
  fill_structure(tool, tip, position_covariance, state);
  return true;
}

// Distance to the nearest critical structure, with its error: that of the tip, and that of the registration of the
// image in which the structure was segmented. The two are independent.
void NavigationPipeline::fill_structure(Tool &tool, const Vector3d &tip, const Matrix3d &tip_covariance,
                                        wire::NavigationState &state) const noexcept {
  const auto nearest = case_->structures.nearest(tip, tool.warm);
  if (nearest.index < 0) {
    (void)wire::set_name(state.nearest_structure, "");
    state.nearest_structure_mm = state.nearest_structure_sigma_mm = wire::kUnknown;
    return;
  }
  const casefile::Surface &structure = case_->data->structures[static_cast<std::size_t>(nearest.index)];
  const auto [point, direction] = case_->structures.surface_point(nearest.index, tip);
  Matrix3d covariance = tip_covariance;
  if (const auto *image = case_->data->registered_image(structure.segmented_in); image != nullptr) {
    covariance += uncertainty::tre_covariance(image->T_image_source.covariance, point);
  }
  (void)wire::set_name(state.nearest_structure, structure.name);
  state.nearest_structure_mm = nearest.distance_mm;
  state.nearest_structure_sigma_mm = std::sqrt(direction.dot(covariance * direction));
}

// Fields about the predicted position of the plan's target, if the tissue model provides it.
void NavigationPipeline::fill_prediction(const Tool &tool, wire::NavigationState &state) const noexcept {
  state.prediction = bregma_wire_DEFORMATION_NO_MODEL;
  put_unknown(state.predicted_target_mm);
  state.distance_to_predicted_target_mm = wire::kUnknown;
  const bool young = predicted_.generation == generation_ && evaluated_ns_ - predicted_.time_ns < kPredictionAge_ns;
  if (tool.plan == nullptr || !young) {
    return;
  }
  const auto &targets = case_->data->targets;
  const std::size_t count = std::min<std::size_t>(targets.size(), bregma_wire_MAX_TARGETS);
  for (std::size_t i = 0; i < count; ++i) {
    if ((targets[i].position_mm - tool.plan->target_mm).norm() > kSameTarget_mm) {
      continue;
    }
    state.prediction = predicted_.status[i];
    const Vector3d target = Vector3d::Map(predicted_.position_mm[i]); // NaN if it must not be shown
    put(target, state.predicted_target_mm);
    state.distance_to_predicted_target_mm = (target - Vector3d::Map(state.T_image_tip.translation_mm)).norm();
    return;
  }
}

ProbeView NavigationPipeline::probe() const noexcept {
  ProbeView view;
  for (std::size_t i = 0; i < tool_count_; ++i) {
    const wire::NavigationState &state = states_[i];
    if (tools_[i].model->role != casefile::ToolRole::kProbe || state.status != bregma_wire_POSE_LIVE) {
      continue;
    }
    const Vector3d shaft = -tools_[i].model->axis.normalized();
    const auto T_image_tip = wire::from_wire<frame::Image, frame::Tip>(state.T_image_tip);
    view.live = true;
    view.acquired_ns = state.acquired_time_ns;
    view.valid_until_ns = measured_until_ns(state.acquired_time_ns);
    Vector3d::Map(view.tip_mm) = T_image_tip.translation();
    Vector3d::Map(view.shaft) = T_image_tip.rotation() * shaft;
    Vector3d::Map(view.shaft_in_tool) = shaft;
    return view;
  }
  return view;
}

} // namespace bregma::server
