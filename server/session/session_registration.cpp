// Commands from touches and traces to a verified registration.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "server/session/session_core.hpp"
#include "server/session/session_text.hpp"
#include "server/session/verdicts.hpp"

namespace bregma::server {

namespace {
// A check touch that is shown farther from its landmark is no touch of it.
constexpr double kMaxCheckDistance_mm = 50.0;
constexpr int kMissedChecks = 2; // after these the registration is demoted
} // namespace

Answer Session::Impl::start_registration() {
  abandon("the registration was started anew");
  clear_samples();
  return {.text = "touch the fiducials: " + names_of(case_->fiducials)};
}

Outcome Session::Impl::touch(const Ticket &ticket, wire::CaptureKind kind, const bregma_wire_TouchBody &body) {
  const bool check = kind == bregma_wire_CAPTURE_CHECK;
  const std::string point = wire::text(body.point);
  if (const auto tool = find_tool_with_tip(wire::text(body.tool)); !tool) {
    return tool.error();
  }
  if (check && case_->landmark(point) == nullptr) {
    return refused(not_in_case(*case_, "landmark", point, case_->landmarks));
  }
  if (!check && case_->fiducial(point) == nullptr) {
    return refused(not_in_case(*case_, "fiducial", point, case_->fiducials));
  }
  if (capture_) {
    return refused("another touch is being captured: " + wire::text(capture_->request.point));
  }
  if (accept_) {
    return refused("a registration is being accepted");
  }
  CaptureRequest request{next_request_++, kind, {}, {}, now_ns, 0, config_.capture_max_motion_mm};
  std::copy(std::begin(body.tool), std::end(body.tool), request.tool);
  std::copy(std::begin(body.point), std::end(body.point), request.point);
  request.window_ns = std::llround(config_.capture_window_ms * kNanosecondsPerMs);
  capture_ = {ticket, request,
              now_ns + request.window_ns + std::llround(config_.answer_timeout_ms * kNanosecondsPerMs)};
  ports_.send(NavigationMessage(request));
  return std::nullopt;
}

void Session::Impl::on_capture(const CaptureResult &result) {
  if (!capture_ || capture_->request.id != result.id) {
    return; // result of an abandoned command
  }
  const PendingCapture capture = *capture_;
  capture_.reset();
  if (const auto refusal = refuse_capture(capture.request, result)) {
    answer(capture.ticket, refused(*refusal));
  } else if (const auto by_state = machine_.refusal(capture.ticket.kind)) { // the state changed in the meantime
    answer(capture.ticket, {bregma_wire_COMMAND_REFUSED_BY_STATE, *by_state});
  } else if (capture.request.kind == bregma_wire_CAPTURE_CHECK) {
    answer(capture.ticket, take_check(capture.request, result));
  } else {
    answer(capture.ticket, take_fiducial(capture.request, result));
  }
}

Answer Session::Impl::take_fiducial(const CaptureRequest &request, const CaptureResult &result) {
  FiducialSample sample{
      ++data_.revision, {}, {}, result.frame, result.acquired_time_ns, result.position_mm, result.covariance_mm2,
      result.common_mm2};
  std::copy(std::begin(request.tool), std::end(request.tool), sample.tool);
  std::copy(std::begin(request.point), std::end(request.point), sample.point);
  const std::string point = wire::text(request.point);
  const bool again = data_.fiducials.contains(point);
  data_.fiducials[point] = sample;
  changed();
  ports_.send(RegistrationMessage(sample));
  show(captured_point(sample, bregma_wire_CAPTURE_FIDUCIAL_TOUCH, point));
  return {.text = point + (again ? " touched again" : " touched") + " (" + std::to_string(data_.fiducials.size()) +
                  " of " + std::to_string(case_->fiducials.size()) + "), " + std::to_string(result.used_frames) +
                  " frames, moved " + mm(result.motion_mm) + " beyond the markers' noise",
          .value_mm = result.motion_mm};
}

Answer Session::Impl::take_check(const CaptureRequest &request, const CaptureResult &result) {
  const std::string name = wire::text(request.point);
  const auto index = static_cast<std::size_t>(case_->landmark(name) - case_->landmarks.data());
  const JudgedCheck check = judge_check(*case_, *data_.accepted, index, request.tool, result);
  if (!(check.distance_mm <= kMaxCheckDistance_mm)) {
    return miss_check(request, check);
  }
  if (check.distance_mm <= case_->limits.max_check_mm) {
    clear_missed_checks();
    TrackingConfirmed confirmed{};
    std::copy(std::begin(request.tool), std::end(request.tool), confirmed.tool);
    ports_.send(NavigationMessage(confirmed));
  }
  data_.checks[name] = check;
  changed();
  ports_.send(MonitoringMessage(check));
  show(captured_point(check, bregma_wire_CAPTURE_CHECK, name));
  std::string text = name + " is shown " + mm(check.distance_mm) + " off, 95 % bound " + mm(check.limit_mm);
  if (check.distance_mm > case_->limits.max_check_mm) {
    text += ": more than the limit of " + mm(case_->limits.max_check_mm);
  } else if (check.distance_mm > check.limit_mm) {
    text += ": beyond the bound";
  }
  return {.text = text, .value_mm = check.distance_mm};
}

Answer Session::Impl::miss_check(const CaptureRequest &request, const JudgedCheck &check) {
  const std::string name = wire::text(request.point);
  if (++missed_checks_ >= kMissedChecks) {
    AlarmCondition missed{};
    (void)wire::set_name(missed.kind, alarm::kCheckMissed);
    (void)wire::set_name(missed.subject, case_->reference() != nullptr ? case_->reference()->name : "");
    missed.active = true;
    missed.severity = bregma_wire_SEVERITY_CRITICAL;
    missed.effect = SessionEffect::kDemote;
    missed.time_ns = now_ns;
    wire::set_text(missed.text, std::to_string(missed_checks_) + " check touches were more than " +
                                    mm(kMaxCheckDistance_mm) +
                                    " from their landmarks: the reference may have been "
                                    "knocked off. Look at it, then check the landmarks or register anew.");
    on_condition(missed);
  }
  return refused("the tip of " + wire::text(request.tool) + " is shown " + mm(check.distance_mm) + " from " + name +
                 ": that is no touch of it (limit " + mm(kMaxCheckDistance_mm) +
                 "). Touch the landmark itself; if you did, the reference has moved");
}

void Session::Impl::clear_missed_checks() {
  missed_checks_ = 0;
  if (case_ != nullptr && case_->reference() != nullptr) {
    condition(alarm::kCheckMissed, case_->reference()->name, false, bregma_wire_SEVERITY_CRITICAL, "");
    condition(alarm::kCheckExpired, case_->reference()->name, false, bregma_wire_SEVERITY_CRITICAL, "");
  }
}

Answer Session::Impl::remove_fiducial(const std::string &point) {
  if (case_->fiducial(point) == nullptr) {
    return refused(not_in_case(*case_, "fiducial", point, case_->fiducials));
  }
  if (data_.fiducials.erase(point) == 0) {
    return refused(point + " has not been touched");
  }
  FiducialRemoved removed{++data_.revision, {}};
  (void)wire::set_name(removed.point, point);
  changed();
  ports_.send(RegistrationMessage(removed));
  hide_points(); // a point cannot be taken back from an instance: those that are left are published again
  show_points();
  return {.text = point + " is removed, " + std::to_string(data_.fiducials.size()) + " fiducials are left"};
}

// While Registering, trace samples belong to the registration. Afterwards they show the current position of the skin to
// the drift test.
Answer Session::Impl::start_trace(const std::string &tool) {
  if (const auto found = find_tool_with_tip(tool); !found) {
    return found.error();
  }
  if (const auto refusal = refuse_surface()) {
    return *refusal;
  }
  const bool registering = machine_.stage() == bregma_wire_SESSION_REGISTERING;
  tracing_ = tool;
  traced_ = 0;
  TraceRequest request{{}, true, config_.trace_spacing_mm};
  (void)wire::set_name(request.tool, tool);
  ports_.send(NavigationMessage(request));
  return {.text = "lead the tip of " + tool + " over the skin" + (registering ? "" : "; it checks for drift")};
}

std::optional<Answer> Session::Impl::refuse_surface() const {
  if (!tracing_.empty()) {
    return refused("a trace with " + tracing_ + " is running: stop it first");
  }
  if (accept_) {
    return refused("a registration is being accepted");
  }
  if (machine_.stage() == bregma_wire_SESSION_REGISTERING && data_.surface.size() >= config_.trace_max_samples) {
    return refused("there are " + std::to_string(data_.surface.size()) + " surface samples, the maximum");
  }
  return std::nullopt;
}

// The points of the scan are samples like those of a trace, made by the sensor instead of a tip. Its motion is
// commanded separately, from the arm.
std::optional<Answer> Session::Impl::refuse_arm(const std::string &device) const {
  if (!case_->robot) {
    return refused("case " + case_->id + " has no arm: [robot] in its case.toml names one");
  }
  if (device != case_->robot->device) {
    return refused("arm \"" + device + "\" is not that of case " + case_->id + ", " + case_->robot->device);
  }
  return std::nullopt;
}

Answer Session::Impl::start_scan(const bregma_wire_ScanBody &body) {
  const std::string device = wire::text(body.device);
  const std::string name = wire::text(body.sensor);
  if (auto refusal = refuse_arm(device)) {
    return *refusal;
  }
  const auto &sensors = case_->robot->equipment.sensors;
  const auto sensor = std::find_if(sensors.begin(), sensors.end(), [&](const auto &one) { return one.name == name; });
  if (sensor == sensors.end()) {
    return refused(not_in_case(*case_, "sensor", name, sensors));
  }
  if (const auto refusal = refuse_surface()) {
    return *refusal;
  }
  // What a sensor reads too far on tilted skin is estimated once per registration.
  const auto other = std::find_if(data_.surface.begin(), data_.surface.end(), [&](const SurfaceSample &sample) {
    return sample.towards_sensor != Array3{} && wire::view(sample.tool) != name;
  });
  if (other != data_.surface.end() && sensor->excess_mm > 0.0) {
    return refused("the registration has points of " + wire::text(other->tool) +
                   ", and its scans are made with one sensor: start the registration anew");
  }
  ScanRequest request{};
  request.on = true;
  std::copy(std::begin(body.device), std::end(body.device), request.arm);
  std::copy(std::begin(body.sensor), std::end(body.sensor), request.sensor);
  request.spacing_mm = body.spacing_mm > 0.0 ? body.spacing_mm : config_.trace_spacing_mm;
  Eigen::Map<geometry::Vector3d>(request.origin_mm.data()) = sensor->origin_mm;
  Eigen::Map<geometry::Vector3d>(request.direction.data()) = sensor->direction;
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(request.beam_covariance.data()) = sensor->covariance;
  request.curved = sensor->curve.has_value();
  if (sensor->curve) {
    const range::PowerLawFit &curve = *sensor->curve;
    request.curve_scale_mm = curve.law.scale_mm;
    request.curve_exponent = curve.law.exponent;
    Eigen::Map<Eigen::Matrix2d>(request.curve_covariance.data()) = curve.covariance;
    request.curve_rms_mm = curve.corrected_rms_mm;
    static_assert(kMaxCurvePoints == casefile::kMaxCurveCorrections);
    for (const range::CurveCorrection &correction : curve.corrections) {
      request.curve_corrections[request.curve_points++] = {correction.reading, correction.add_mm};
    }
  }
  request.reads_tilted = sensor->excess_mm > 0.0;
  request.window = sensor->window;
  request.delay_ns = std::llround(sensor->delay_ms * kNanosecondsPerMs);
  request.sigma_mm = sensor->sigma_mm;
  request.near_mm = sensor->near_mm;
  request.far_mm = sensor->far_mm;
  if (const casefile::HandEyeModel *hand_eye = case_->hand_eye()) {
    request.beside_tracker = true;
    (void)wire::set_name(request.reference, case_->reference()->name);
    request.T_base_tracker = wire::to_wire(hand_eye->T_base_tracker.pose);
    Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(request.tracker_covariance.data()) =
        hand_eye->T_base_tracker.covariance;
  }
  scan_ = request;
  tracing_ = name;
  traced_ = 0;
  ports_.send(request);
  const bool registering = machine_.stage() == bregma_wire_SESSION_REGISTERING;
  return {.text = "lead the beam of " + name + " over the skin" + (registering ? "" : "; it checks for drift")};
}

Answer Session::Impl::stop_scan(const std::string &device) {
  if (!scan_ || wire::view(scan_->arm) != device) {
    return refused("no scan with arm \"" + device + "\" is running");
  }
  return stop_trace(tracing_);
}

void Session::Impl::on_arm_replaced() {
  if (machine_.stage() == bregma_wire_SESSION_REGISTERING && !(data_.fiducials.empty() && data_.surface.empty())) {
    arm_replaced_ = true;
    ports_.log("the arm was restarted or replaced: the samples of this registration are void");
  }
}

// Nothing measures whether the patient still lies where the registration was made: only a touch does.
void Session::Impl::poll_checks() {
  if (!case_ || !case_->arm_alone() || !machine_.verified()) {
    return;
  }
  std::int64_t newest_ns = 0;
  for (const auto &[name, check] : data_.checks) {
    newest_ns = std::max(newest_ns, check.acquired_time_ns);
  }
  if (static_cast<double>(now_ns - newest_ns) <= config_.check_valid_min * 60e3 * kNanosecondsPerMs) {
    return;
  }
  AlarmCondition expired{};
  (void)wire::set_name(expired.kind, alarm::kCheckExpired);
  (void)wire::set_name(expired.subject, case_->reference()->name);
  expired.active = true;
  expired.severity = bregma_wire_SEVERITY_CRITICAL;
  expired.effect = SessionEffect::kDemote;
  expired.time_ns = now_ns;
  wire::set_text(expired.text, "the patient is not tracked, and the last check touch is more than " +
                                   std::to_string(std::lround(config_.check_valid_min)) +
                                   " minutes old: check the landmarks and confirm");
  on_condition(expired);
}

void Session::Impl::end_trace() {
  if (scan_) {
    scan_->on = false;
    ports_.send(*scan_);
    scan_.reset();
    tracing_.clear();
    return;
  }
  TraceRequest request{{}, false, config_.trace_spacing_mm};
  (void)wire::set_name(request.tool, tracing_);
  tracing_.clear();
  ports_.send(NavigationMessage(request));
}

Answer Session::Impl::stop_trace(const std::string &tool) {
  if (tracing_ != tool || tracing_.empty()) {
    return refused("no trace with \"" + tool + "\" is running" +
                   (tracing_.empty() ? "" : "; one with " + tracing_ + " is"));
  }
  end_trace();
  return {.text = std::to_string(traced_) + " surface samples traced, " + std::to_string(data_.surface.size()) +
                  " in the registration"};
}

void Session::Impl::on_surface(SurfaceSample sample) {
  const auto finite = [](double value) { return std::isfinite(value); };
  if (tracing_.empty() || wire::view(sample.tool) != tracing_ ||
      !std::all_of(sample.position_mm.begin(), sample.position_mm.end(), finite) ||
      !std::all_of(sample.covariance_mm2.begin(), sample.covariance_mm2.end(), finite)) {
    return; // a late sample of a stopped trace, or one without a measurement
  }
  ++traced_;
  show(captured_point(sample, bregma_wire_CAPTURE_SURFACE, ""));
  if (machine_.stage() != bregma_wire_SESSION_REGISTERING) {
    ports_.send(MonitoringMessage(sample));
    return;
  }
  sample.revision = ++data_.revision;
  data_.surface.push_back(sample);
  changed();
  ports_.send(RegistrationMessage(sample));
  if (data_.surface.size() >= config_.trace_max_samples) {
    ports_.log("the trace ends: " + std::to_string(data_.surface.size()) + " surface samples are kept at most");
    end_trace();
  }
}

Outcome Session::Impl::accept_registration(const Ticket &ticket) {
  if (!tracing_.empty()) {
    return refused("a trace with " + tracing_ + " is running: stop it first");
  }
  if (capture_ || accept_) {
    return refused(capture_ ? "a touch is being captured: wait for it" : "a registration is being accepted");
  }
  if (data_.fiducials.empty() && data_.surface.empty()) {
    return refused("there are no samples: touch the fiducials first");
  }
  if (arm_replaced_) {
    return refused("the arm was restarted or replaced since the first samples: start the registration anew");
  }
  if (estimate_ && estimate_->revision == data_.revision) {
    return take_registration();
  }
  accept_ = {ticket, now_ns + std::llround(config_.answer_timeout_ms * kNanosecondsPerMs)};
  return std::nullopt;
}

void Session::Impl::on_estimate(const RegistrationEstimate &estimate) {
  estimate_ = estimate;
  if (accept_ && estimate.revision == data_.revision) {
    const Ticket ticket = accept_->ticket;
    accept_.reset();
    answer(ticket, take_registration());
  }
}

Answer Session::Impl::take_registration() {
  if (const auto refusal = refuse_acceptance(*case_, *estimate_)) {
    return refused(*refusal);
  }
  clear_missed_checks();
  data_.accepted = accept(*estimate_);
  data_.checks.clear();
  changed();
  send_all(*data_.accepted);
  const TargetTre worst = worst_target(*case_, *data_.accepted);
  return {.text = (worst.target.empty()
                       ? std::string("the case has no target")
                       : "predicted TRE at " + worst.target + " " + mm(worst.rms_mm) + placing_text(worst)) +
                  "; check at least " + std::to_string(config_.min_checks) + " landmarks" +
                  (std::isfinite(estimate_->fre_mm) ? " (FRE " + mm(estimate_->fre_mm) + " says nothing about accuracy)"
                                                    : std::string()),
          .value_mm = estimate_->fre_mm};
}

Answer Session::Impl::confirm_verification() {
  if (capture_) {
    return refused("a touch is being captured: wait for it");
  }
  if (alarm_registry_.unacknowledged(alarm::kDrift)) {
    return refused("a drift alarm is not acknowledged: acknowledge it, then check the landmarks again");
  }
  if (const auto refusal = refuse_verification(*case_, *data_.accepted, data_.checks, config_.min_checks)) {
    return refused(*refusal);
  }
  double worst = 0.0;
  for (const auto &[name, check] : data_.checks) {
    worst = std::max(worst, check.distance_mm);
  }
  return {.text = "verified by " + std::to_string(data_.checks.size()) + " landmarks, the worst " + mm(worst) + " off",
          .value_mm = worst};
}

void Session::Impl::clear_samples() {
  data_.fiducials.clear();
  data_.surface.clear();
  data_.checks.clear();
  arm_replaced_ = false;
  clear_missed_checks();
  data_.accepted.reset();
  estimate_.reset();
  changed();
  hide_points();
  send_all(RegistrationReset{++data_.revision});
}

void Session::Impl::show(const wire::CapturedPoint &point) {
  shown_tools_.insert(wire::text(point.tool));
  ports_.publish(point);
}

void Session::Impl::show_points() {
  for (const auto &[name, sample] : data_.fiducials) {
    show(captured_point(sample, bregma_wire_CAPTURE_FIDUCIAL_TOUCH, name));
  }
  for (const SurfaceSample &sample : data_.surface) {
    show(captured_point(sample, bregma_wire_CAPTURE_SURFACE, ""));
  }
}

void Session::Impl::hide_points() {
  for (const std::string &tool : std::exchange(shown_tools_, {})) {
    wire::CapturedPoint last{};
    (void)wire::set_name(last.tool, tool);
    std::fill(std::begin(last.position_mm), std::end(last.position_mm), wire::kUnknown);
    std::fill(std::begin(last.covariance_mm2), std::end(last.covariance_mm2), wire::kUnknown);
    last.ended = true;
    ports_.publish(last);
  }
}

} // namespace bregma::server
