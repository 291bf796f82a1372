#include "server/stages/monitoring/pipeline.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "algorithms/registration/surface/tilt_excess.hpp"
#include "server/stages/monitoring/plausibility_text.hpp"
#include "server/stages/navigation/hand_eye_check.hpp"
#include "server/stages/schedules.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

// Joins the parts of a sentence without allocation; truncates the text if it does not fit.
struct Sentence {
  char text[256] = {};
  std::size_t length = 0;
  Sentence &operator<<(std::string_view piece) noexcept {
    const std::size_t count = std::min(piece.size(), sizeof text - 1 - length);
    std::copy_n(piece.data(), count, text + length);
    length += count;
    return *this;
  }
};

// A measured rate above the stated one by this factor contradicts it.
constexpr double kRateTolerance = 1.25;

// An operation may last longer than this, and its recording must not end before it.
constexpr double kRecordingHours = 1.0;

// A body on the flange may be covered for a moment.
constexpr std::int64_t kUnchecked_ns = 5'000'000'000;
constexpr std::int64_t kTracked_ns = 1'000'000'000; // since the last frame: the tracker sends

std::uint64_t rejected(const wire::DeviceHealth &device) noexcept {
  std::uint64_t sum = 0;
  for (const std::uint64_t count : device.rejected) {
    sum += count;
  }
  return sum;
}

} // namespace

MonitoringPipeline::MonitoringPipeline(const MonitoringParameters &parameters, AlarmEvents &alarms)
    : parameters_(parameters), alarms_(alarms), drift_(parameters.false_alarm_rate) {
  on(CaseChanged{0, nullptr});
}

AlarmConditions::Kind MonitoringPipeline::kind(const char *name, wire::AlarmSeverity severity,
                                               SessionEffect effect) const noexcept {
  return {name, severity, effect, ns_of_ms(parameters_.raise_after_ms), ns_of_ms(parameters_.clear_after_ms)};
}

void MonitoringPipeline::handle(const MonitoringInput &input) noexcept {
  std::visit([this](const auto &content) noexcept { on(content); }, input);
}

void MonitoringPipeline::end_state(std::int64_t now_ns) noexcept {
  wire::AccuracyState last{};
  copy_name(last.reference, accuracy_.reference);
  last.time_ns = now_ns;
  last.fre_mm = last.fre_expected_mm = last.last_check_mm = last.last_check_limit_mm = wire::kUnknown;
  last.ended = true;
  accuracy_ = last;
}

void MonitoringPipeline::on(const CaseChanged &change) noexcept {
  // Conditions about tools and reference of an earlier case are void.
  for (const char *kind : {alarm::kToolHidden, alarm::kLatency, alarm::kReferenceHidden, alarm::kDrift,
                           alarm::kImplausible, alarm::kHandEye, alarm::kHandEyeUnchecked, alarm::kUnknownTool}) {
    alarms_.forget(kind, accuracy_.time_ns);
  }
  case_ = change.loaded;
  tracked_since_ns_ = 0;
  accepted_.reset();
  accuracy_ = {};
  const casefile::ToolModel *reference = case_ != nullptr ? case_->data->reference() : nullptr;
  (void)wire::set_name(accuracy_.reference,
                       reference != nullptr ? std::string_view(reference->name) : std::string_view());
  restart_drift();
  predict_targets();
}

void MonitoringPipeline::on(const MonitoringMessage &message) noexcept {
  struct Visitor {
    MonitoringPipeline &self;
    void operator()(const SessionChanged &change) const noexcept { self.session_ = change; }
    void operator()(const JudgedCheck &touch) const noexcept { self.add(touch); }
    void operator()(const SurfaceSample &sample) const noexcept { self.add(sample); }
    void operator()(const DriftRestart &) const noexcept { self.restart_drift(); }
    void operator()(const RegistrationAccepted &accepted) const noexcept {
      self.accepted_ = {wire::from_wire<frame::Image, frame::Reference>(accepted.T_image_reference),
                        matrix_of(accepted.covariance)};
      self.excess_mm_ = vector_of(accepted.excess_mm);
      self.restart_drift();
      self.predict_targets();
    }
    void operator()(const RegistrationReset &) const noexcept {
      self.accepted_.reset();
      self.restart_drift();
      self.predict_targets();
    }
  };
  std::visit(Visitor{*this}, message);
}

void MonitoringPipeline::restart_drift() noexcept {
  Matrix6d prior = accepted_ ? accepted_->covariance : Matrix6d::Zero();
  // The error of a second image's registration is common to the landmarks placed in it, as that of the pose is to all.
  for (std::size_t i = 0; accepted_ && case_ != nullptr && i < case_->data->images.size(); ++i) {
    const casefile::RegisteredImage &image = case_->data->images[i];
    const auto placed_here = [&image](const casefile::NamedPoint &point) { return point.placed_in == image.name; };
    const auto &landmarks = case_->data->landmarks;
    if (std::any_of(landmarks.begin(), landmarks.end(), placed_here)) {
      prior += image.T_image_source.covariance;
    }
  }
  drift_.reset(prior);
  accuracy_.check_count = 0;
  accuracy_.last_check_mm = accuracy_.last_check_limit_mm = wire::kUnknown;
}

void MonitoringPipeline::add(const JudgedCheck &touch) noexcept {
  if (!accepted_ || case_ == nullptr || touch.landmark_index >= case_->data->landmarks.size()) {
    return;
  }
  const double landmark_sigma = case_->data->limits.landmark_sigma_mm;
  const casefile::NamedPoint &landmark = case_->data->landmarks[touch.landmark_index];
  drift_.add_check({static_cast<int>(touch.landmark_index), landmark.position_mm, vector_of(touch.error_mm),
                    matrix_of(touch.touch_covariance_mm2),
                    landmark.placing_covariance_mm2 + Matrix3d::Identity() * landmark_sigma * landmark_sigma});
  ++accuracy_.check_count;
  accuracy_.last_check_mm = touch.distance_mm;
  accuracy_.last_check_limit_mm = touch.limit_mm;
}

// Skin traced after acceptance: tests whether it is still at its registered position.
void MonitoringPipeline::add(const SurfaceSample &sample) noexcept {
  if (!accepted_ || case_ == nullptr) {
    return;
  }
  const Matrix3d R = accepted_->pose.rotation_matrix();
  Vector3d point = accepted_->pose * vector_of(sample.position_mm);
  if (const Vector3d up = R * vector_of(sample.towards_sensor); !up.isZero()) {
    // Without what the sensor reads too far there, as in the registration.
    const Vector3d across = R * vector_of(sample.across);
    point += registration::excess_terms(case_->scalp.closest(point).normal, up, across).dot(excess_mm_) * up;
  }
  const auto closest = case_->scalp.closest(point);
  const double own = closest.normal.dot(R * matrix_of(sample.covariance_mm2) * R.transpose() * closest.normal);
  const double skin = case_->data->limits.surface_sigma_mm;
  drift_.add_surface_residual(point, closest.signed_mm, std::sqrt(skin * skin + own), closest.normal,
                              R * matrix_of(sample.common_mm2) * R.transpose());
}

void MonitoringPipeline::predict_targets() noexcept {
  accuracy_.target_count = 0;
  if (case_ == nullptr) {
    return;
  }
  for (const casefile::NamedPoint &target : case_->data->targets) {
    if (accuracy_.target_count == bregma_wire_MAX_TARGETS) {
      break;
    }
    wire::TargetAccuracy &out = accuracy_.targets[accuracy_.target_count++];
    (void)wire::set_name(out.target, target.name);
    out.image_rms_mm = uncertainty::rms_mm(target.placing_covariance_mm2);
    if (!accepted_) {
      out.tre_rms_mm = wire::kUnknown;
      put_unknown(out.covariance_mm2);
      out.tre_95 = unknown_ellipsoid();
      continue;
    }
    // The errors of the two registrations are independent.
    const Matrix3d covariance =
        uncertainty::tre_covariance(accepted_->covariance, target.position_mm) + target.placing_covariance_mm2;
    out.tre_rms_mm = uncertainty::rms_mm(covariance);
    put(covariance, out.covariance_mm2);
    out.tre_95 = to_wire(uncertainty::ellipsoid_95(covariance));
  }
}

void MonitoringPipeline::step(const MonitoringView &view, std::int64_t now_ns) noexcept {
  accuracy_.time_ns = now_ns;
  accuracy_.fre_mm = view.registration.fre_mm;
  accuracy_.fre_expected_mm = view.registration.fre_expected_mm;
  accuracy_.drift_statistic = drift_.statistic();
  accuracy_.drift_threshold = drift_.threshold();
  accuracy_.drift_detected = drift_.detected();

  watch_devices(view, now_ns);
  watch_tracking(view.tracking, now_ns);
  watch_plausibility(view.tracking, now_ns);
  watch_hand_eye(view.tracking, now_ns);
  watch_hand_eye_checks(view.tracking, now_ns);
  watch_unknown(view, now_ns);
  watch_system(view, now_ns);
  watch_clock(view.wall_lead_ns, now_ns);
  // The test itself decides the time; its verdict is kept until the test is restarted.
  alarms_.update({alarm::kDrift, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kDemote, 0, 0},
                 wire::view(accuracy_.reference), drift_.detected(),
                 "the reference has moved against the head: register again, or check the landmarks", now_ns);
}

void MonitoringPipeline::watch_devices(const MonitoringView &view, std::int64_t now_ns) noexcept {
  std::size_t index = 0;
  for (const inputs::StreamHealth *stream : {&view.trackers, &view.sensors}) {
    for (std::uint32_t i = 0; i < stream->device_count && index < std::size(rejected_seen_); ++i, ++index) {
      const wire::DeviceHealth &device = stream->devices[i];
      const std::string_view name = wire::view(device.device);
      watch_loss(device, now_ns);

      Sentence refused;
      refused << name << " sends samples that are rejected: see bregma status for the reasons";
      Sentence rate;
      rate << name << " sends more often than it states: its stated rate is not used";
      alarms_.update(kind(alarm::kDeviceRate, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone), name,
                     device.rate_hz > kRateTolerance * device.stated_rate_hz, rate.text, now_ns);
      const std::uint64_t count = rejected(device);
      // Faulty samples are single events: the first one raises an alarm, which clears after a time without any.
      alarms_.update({alarm::kRejected, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0,
                      ns_of_ms(parameters_.clear_after_ms)},
                     name, count != std::exchange(rejected_seen_[index], count), refused.text, now_ns);

      // Of two writers only one is used, so nothing is shown wrong. But it may be the wrong one.
      const bool took_over = device.takeovers != std::exchange(takeovers_seen_[index], device.takeovers);
      const bool refused_other = device.other_writer != std::exchange(other_writer_seen_[index], device.other_writer);
      Sentence other;
      other << "two drivers send as " << name << ": "
            << (took_over ? "the second is used now, because the first was lost" : "only the first is used")
            << "; stop one of them";
      alarms_.update({alarm::kOtherWriter, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kNone, 0,
                      ns_of_ms(parameters_.clear_after_ms)},
                     name, took_over || refused_other, other.text, now_ns);
    }
  }
}

// Without a tracker the arm of the case takes its place, and a tracker is a device like others. Beside a tracker that
// hand-eye ties to it, no pose of the arm's tools is shown without either.
void MonitoringPipeline::watch_loss(const wire::DeviceHealth &device, std::int64_t now_ns) noexcept {
  const std::string_view name = wire::view(device.device);
  const auto *robot = case_ != nullptr && case_->data->robot ? &*case_->data->robot : nullptr;
  const casefile::HandEyeModel *hand_eye = case_ != nullptr ? case_->data->hand_eye() : nullptr;
  const bool tracker = device.kind == bregma_wire_DEVICE_TRACKER &&
                       (robot == nullptr || (hand_eye != nullptr && name == hand_eye->tracker));
  const bool arm = robot != nullptr && device.kind == bregma_wire_DEVICE_ROBOT && name == robot->device;
  Sentence text;
  text << name << " is silent";
  if (tracker || arm) { // tracked tools are shown without the arm
    text << (arm && hand_eye != nullptr ? ": no pose of its tools is shown" : ": no pose is shown");
  }
  const bool lost = device.status == bregma_wire_DEVICE_LOST;
  // Each kind at every step: with another case the same device is of another one. A device counts as lost only after
  // its deadline, so half of the hysteresis is enough for a step of its clock.
  const auto update = [&](const char *kind, bool critical, bool holds) {
    alarms_.update({kind, critical ? bregma_wire_SEVERITY_CRITICAL : bregma_wire_SEVERITY_WARNING,
                    critical ? SessionEffect::kDegrade : SessionEffect::kNone,
                    ns_of_ms(0.5 * parameters_.raise_after_ms), ns_of_ms(parameters_.clear_after_ms)},
                   name, holds, text.text, now_ns);
  };
  update(alarm::kTrackerLost, true, lost && tracker);
  update(alarm::kRobotLost, true, lost && arm);
  update(alarm::kDeviceLost, false, lost && !tracker && !arm);
}

void MonitoringPipeline::watch_tracking(const TrackingView &tracking, std::int64_t now_ns) noexcept {
  const bool navigating = session_.state == bregma_wire_SESSION_NAVIGATING;
  bool tracked = false; // frames arrive: a missing body is hidden, not silent like all others
  for (std::uint32_t i = 0; i < tracking.tool_count; ++i) {
    const TrackingView::Tool &tool = tracking.tools[i];
    const std::string_view name = wire::view(tool.tool);
    tracked = tracked || (tool.status != bregma_wire_POSE_LOST && tool.status != bregma_wire_POSE_STALE);
    const bool shown = tool.status == bregma_wire_POSE_LIVE || tool.status == bregma_wire_POSE_UNVERIFIED;
    Sentence hidden;
    const bool carried = case_ != nullptr && case_->data->carried_by_arm(name);
    hidden << name << (carried ? " is not the tool that the arm carries" : " is not seen by the tracker");
    alarms_.update(kind(alarm::kToolHidden, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone), name,
                   navigating && tool.planned && tool.status == bregma_wire_POSE_TOOL_HIDDEN, hidden.text, now_ns);
    const bool stale = tool.status == bregma_wire_POSE_STALE;
    Sentence late;
    late << name
         << (stale ? " is not shown: its poses arrive too late"
                   : " is shown late: its pose is older than the limit when it is published");
    alarms_.update(kind(alarm::kLatency, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone), name,
                   (shown || stale) && tool.age_ns > ns_of_ms(parameters_.max_age_ms), late.text, now_ns);
  }
  Sentence hidden;
  hidden << wire::view(accuracy_.reference) << " is not seen by the tracker: no tool is shown";
  alarms_.update(kind(alarm::kReferenceHidden, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone),
                 wire::view(accuracy_.reference), accepted_ && tracked && !tracking.reference_visible, hidden.text,
                 now_ns);
}

// A refusal may be shorter than the period of this stage, so its count is watched too.
void MonitoringPipeline::watch_plausibility(const TrackingView &tracking, std::int64_t now_ns) noexcept {
  const auto watch = [&](const BodyReport &body, std::string_view name, bool is_reference, std::uint64_t &seen) {
    const bool refused = body.judgement.plausibility == bregma_wire_PLAUSIBILITY_REFUSED;
    const bool new_one = body.refusals > std::exchange(seen, body.refusals); // below: another case
    char text[256] = {};
    if (refused || new_one) {
      describe(body, {wire::view(tracking.tracker), name, is_reference}, text);
    }
    alarms_.update({alarm::kImplausible, is_reference ? bregma_wire_SEVERITY_CRITICAL : bregma_wire_SEVERITY_WARNING,
                    SessionEffect::kNone, 0, ns_of_ms(parameters_.clear_after_ms)},
                   name, refused || new_one, text, now_ns);
  };
  watch(tracking.reference, wire::view(accuracy_.reference), true, refusals_seen_[0]);
  for (std::uint32_t i = 0; i < tracking.tool_count; ++i) {
    watch(tracking.tools[i].body, wire::view(tracking.tools[i].tool), false, refusals_seen_[1 + i]);
  }
}

// Raised at once: no tool of the arm is shown any more. It ends when the body on the flange is where it must be again.
void MonitoringPipeline::watch_hand_eye(const TrackingView &tracking, std::int64_t now_ns) noexcept {
  const casefile::HandEyeModel *hand_eye = case_ != nullptr ? case_->data->hand_eye() : nullptr;
  char text[256] = {};
  if (hand_eye != nullptr) {
    (void)std::snprintf(text, sizeof text,
                        "%s is seen %.1f mm from where the arm carries it (statistic %.0f, limit %.0f): the tracker, "
                        "the arm's base or the body has moved; no tool of the arm is shown. Calibrate hand-eye anew",
                        hand_eye->flange_body.c_str(), tracking.hand_eye.distance_mm, tracking.hand_eye.statistic,
                        HandEyeCheck::kThreshold);
  }
  alarms_.update(
      {alarm::kHandEye, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kNone, 0, ns_of_ms(parameters_.clear_after_ms)},
      hand_eye != nullptr ? std::string_view(hand_eye->tracker) : std::string_view(),
      hand_eye != nullptr && tracking.hand_eye.disagrees, text, now_ns);
}

// Of a calibration that nothing checks nobody would know that the tracker was moved. Without frames of the tracker, or
// without the arm, nothing of the arm's tools is shown, and another alarm says so.
void MonitoringPipeline::watch_hand_eye_checks(const TrackingView &tracking, std::int64_t now_ns) noexcept {
  const casefile::HandEyeModel *hand_eye = case_ != nullptr ? case_->data->hand_eye() : nullptr;
  const bool tracked = hand_eye != nullptr && wire::view(tracking.tracker) == hand_eye->tracker &&
                       now_ns - tracking.acquired_ns <= kTracked_ns;
  if (!tracked) {
    tracked_since_ns_ = 0;
  } else if (tracked_since_ns_ == 0) {
    tracked_since_ns_ = now_ns;
  }
  const bool watched = hand_eye != nullptr && !hand_eye->flange_body.empty();
  const std::int64_t checked_ns = std::max(tracking.hand_eye.checked_ns, tracked_since_ns_);
  Sentence text;
  if (watched) {
    text << "nothing checks hand-eye: " << hand_eye->flange_body << " on the flange is not seen by the tracker; that "
         << "tracker or arm were moved is found by check touches only, and the guide is not moved";
  } else if (hand_eye != nullptr) {
    text << "nothing checks hand-eye: the case states no body on the flange (flange_body); that tracker or arm were "
            "moved is found by check touches only, and the guide is not moved";
  }
  alarms_.update({alarm::kHandEyeUnchecked, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0,
                  ns_of_ms(parameters_.clear_after_ms)},
                 hand_eye != nullptr ? std::string_view(hand_eye->tracker) : std::string_view(),
                 tracked && (!watched || now_ns - checked_ns > kUnchecked_ns), text.text, now_ns);
}

void MonitoringPipeline::watch_unknown(const MonitoringView &view, std::int64_t now_ns) noexcept {
  const std::int64_t clear_after_ns = ns_of_ms(parameters_.clear_after_ms);
  const auto watch = [&](const inputs::UnknownNames &names, const char *kind, const char *why) {
    for (const inputs::UnknownNames::Entry &entry : names.entries()) {
      if (entry.name[0] == '\0') {
        continue;
      }
      Sentence text;
      text << wire::view(entry.name) << why;
      alarms_.update({kind, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0, clear_after_ns},
                     wire::view(entry.name), now_ns - entry.last_ns < clear_after_ns, text.text, now_ns);
    }
  };
  for (const inputs::StreamHealth *stream : {&view.trackers, &view.sensors}) {
    watch(stream->unknown_devices, alarm::kUnknownDevice, " sends samples, but is not configured: they are ignored");
    watch(stream->unknown_tools, alarm::kUnknownTool, " is tracked, but is no tool of the case: it is ignored");
  }
}

// A step is a single event: it raises an alarm at once, which clears after a time without another.
void MonitoringPipeline::watch_clock(std::int64_t wall_lead_ns, std::int64_t now_ns) noexcept {
  const bool stepped = clock_watch_.observe(wall_lead_ns, now_ns);
  char text[128];
  (void)std::snprintf(text, sizeof text,
                      "the wall clock was stepped by %+lld ms: ages and alarms do not use it; check the time service",
                      static_cast<long long>(clock_watch_.view().step_ns / 1'000'000));
  alarms_.update(
      {alarm::kWallClock, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0, ns_of_ms(parameters_.clear_after_ms)},
      "", stepped, text, now_ns);
}

void MonitoringPipeline::watch_system(const MonitoringView &view, std::int64_t now_ns) noexcept {
  Sentence disk;
  disk << "the session is not being recorded: " << view.recorder.text;
  alarms_.update(
      {alarm::kDisk, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kNone, 0, ns_of_ms(parameters_.clear_after_ms)}, "",
      view.recorder.failing, disk.text, now_ns);
  const casefile::RecordingSpace &space = view.recorder.space;
  char left[160];
  (void)std::snprintf(left, sizeof left,
                      "the disk of the recording lasts for %.0f minutes more (%.1f GB): remove old recordings, or "
                      "continue on another disk",
                      60.0 * space.hours(), 1e-9 * static_cast<double>(space.free_bytes));
  alarms_.update({alarm::kRecordingSpace, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0,
                  ns_of_ms(parameters_.clear_after_ms)},
                 "", space.bytes_per_s > 0.0 && space.hours() < kRecordingHours, left, now_ns);
  alarms_.update(
      {alarm::kRecordLoss, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0, ns_of_ms(parameters_.clear_after_ms)},
      "", view.recorder.dropped != std::exchange(records_lost_seen_, view.recorder.dropped),
      "the recording of the session has gaps: the disk is too slow, see bregma status", now_ns);
}

} // namespace bregma::server
