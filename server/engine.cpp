#include "server/engine.hpp"

#include <algorithm>
#include <stdexcept>

#include "algorithms/geometry/angles.hpp"
#include "server/pipelines/wire_values.hpp"

namespace bregma::server {
namespace {

enum Loop : std::size_t { kNavigation, kRegistration, kMonitoring, kDeformation, kPoseRecovery, kTissueBuilder };

constexpr std::int64_t ns_of_ms(double milliseconds) { return static_cast<std::int64_t>(milliseconds * 1e6); }

const Config &checked(const Config &config) {
  if (const auto ok = check(config); !ok) {
    throw std::invalid_argument(ok.error().message);
  }
  return config;
}

NavigationSettings navigation_settings(const Config &config) {
  NavigationSettings out;
  out.marker_sigma_lateral_mm = config.tracker.marker_sigma_lateral_mm;
  out.marker_sigma_depth_mm = config.tracker.marker_sigma_depth_mm;
  out.latency_ns = ns_of_ms(config.tracker.latency_ms);
  out.filter_hz = config.navigation.filter_hz;
  return out;
}

MonitoringSettings monitoring_settings(const Config &config) {
  MonitoringSettings out;
  out.false_alarm_rate = config.monitoring.false_alarm_rate;
  out.raise_after_ns = ns_of_ms(config.monitoring.raise_after_ms);
  out.clear_after_ns = ns_of_ms(config.monitoring.clear_after_ms);
  out.max_age_ns = ns_of_ms(config.monitoring.max_age_ms);
  return out;
}

SessionConfig session_config(const Config &config) {
  SessionConfig out;
  out.state_directory = state_directory(config);
  out.capture_window_ms = config.capture.window_ms;
  out.capture_max_motion_mm = config.capture.max_motion_mm;
  out.trace_spacing_mm = config.trace.spacing_mm;
  out.trace_max_samples = static_cast<std::size_t>(config.trace.max_samples);
  out.pivot_min_rotation_rad = config.pivot.min_rotation_deg * geometry::kRadiansPerDegree;
  out.pivot_max_samples = static_cast<std::size_t>(config.pivot.max_samples);
  out.min_checks = static_cast<std::size_t>(config.verification.min_checks);
  return out;
}

TissueSettings tissue_settings(const Config &config) {
  const auto &from = config.deformation;
  TissueSettings out;
  out.elements = static_cast<int>(from.elements);
  out.entry_edge_mm = from.entry_edge_mm;
  out.craniotomy_radius_mm = from.craniotomy_radius_mm;
  out.model.material = tissue::named_material(from.material);
  out.model.solver.threads = static_cast<int>(from.threads);
  out.model.skull.sliding = from.sliding;
  out.model.skull.gap_mm = from.gap_mm;
  out.model.probe.radius_mm = from.probe_radius_mm;
  out.model.insertion.rupture_force_N = from.rupture_force_N;
  out.model.insertion.cutting_force_N = from.cutting_force_N;
  out.model.insertion.shaft_friction_N_per_mm = from.shaft_friction_N_per_mm;
  return out;
}

inputs::DeviceOptions tracker_options(const Config &config) {
  inputs::DeviceOptions out;
  out.clock.minimum_latency_ns = ns_of_ms(config.tracker.latency_ms);
  return out;
}

} // namespace

template <class Message, std::size_t Capacity> void Engine::Outbox<Message, Capacity>::send(const Message &message) {
  flush();
  if (!backlog.empty() || ring.size() == Capacity || !ring.try_push(message)) {
    backlog.push_back(message);
  }
}

template <class Message, std::size_t Capacity> void Engine::Outbox<Message, Capacity>::flush() {
  while (!backlog.empty() && ring.size() < Capacity && ring.try_push(backlog.front())) {
    backlog.pop_front();
  }
}

Engine::Engine(const Config &config, ControlOutlet &outlet, Session::Executor executor)
    : config_(checked(config)), outlet_(outlet),
      tracker_border_(split_names(config_.devices.trackers), tracker_options(config_)),
      navigation_(navigation_settings(config_), navigation_events_),
      robot_border_(split_names(config_.devices.robots), {}), range_border_(split_names(config_.devices.ranges), {}),
      force_border_(split_names(config_.devices.forces), {}),
      registration_(static_cast<std::size_t>(config_.trace.max_samples)),
      monitoring_(monitoring_settings(config_), alarm_events_), tissue_builder_(tissue_settings(config_)),
      session_(std::make_unique<Session>(session_config(config_), static_cast<SessionPorts &>(*this),
                                         std::move(executor))) {}

Engine::~Engine() = default;

// ---- control ----

base::Result<void> Engine::use_case(std::shared_ptr<const casefile::Case> loaded) {
  std::unique_ptr<LoadedCase> fresh;
  if (loaded) {
    try {
      fresh = std::make_unique<LoadedCase>(loaded, config_.registration.correlation_length_mm,
                                           static_cast<int>(config_.trace.max_samples));
    } catch (const std::invalid_argument &error) {
      return base::failure((loaded->folder / "case.toml").string() + ": " + error.what());
    }
  }
  const CaseChanged change{++generation_, fresh.get()};
  cases_.emplace_back(generation_, std::move(fresh));
  to_navigation_.send(change);
  to_registration_.send(change);
  to_monitoring_.send(change);
  to_deformation_.send(change);
  to_pose_recovery_.send(change);
  to_tissue_builder_.send(change);
  outlet_.case_changed(loaded.get());
  return {};
}

void Engine::send(const NavigationMessage &message) { to_navigation_.send(message); }

void Engine::send(const RegistrationMessage &message) { to_registration_.send(message); }

void Engine::send(const MonitoringMessage &message) { to_monitoring_.send(message); }

void Engine::poll(std::int64_t now_ns) {
  NavigationEvent event;
  while (navigation_events_.try_pop(event)) {
    session_->on(event, now_ns);
  }
  AlarmCondition condition;
  while (alarm_events_.try_pop(condition)) {
    session_->on(condition, now_ns);
  }
  wire::RegistrationState estimate;
  if (registration_state_.load_newer(estimate, seen_registration_)) {
    session_->on(estimate, now_ns);
  }
  session_->poll(now_ns);
  to_navigation_.flush();
  to_registration_.flush();
  to_monitoring_.flush();
  to_deformation_.flush();
  to_pose_recovery_.flush();
  to_tissue_builder_.flush();
  free_unused_cases();
}

void Engine::free_unused_cases() {
  std::uint64_t oldest = generation_;
  for (const auto &taken : taken_generation_) {
    oldest = std::min(oldest, taken.load(std::memory_order_acquire));
  }
  std::erase_if(cases_, [oldest](const auto &entry) { return entry.first < oldest; });
}

std::uint64_t Engine::dropped_messages() const { return navigation_events_.dropped() + alarm_events_.dropped(); }

// ---- navigation ----

void Engine::receive_navigation() noexcept {
  NavigationInput input;
  while (to_navigation_.ring.try_pop(input)) {
    navigation_.handle(input);
    if (const auto *change = std::get_if<CaseChanged>(&input)) {
      tracker_border_.set_tools(change->loaded != nullptr ? change->loaded->tools : inputs::KnownTools{});
      taken_generation_[kNavigation].store(change->generation, std::memory_order_release);
    }
  }
}

bool Engine::take(const wire::TrackerFrame &frame, std::uint64_t writer, std::int64_t now_ns) noexcept {
  const inputs::Verdict verdict = tracker_border_.check(frame, writer, now_ns);
  if (verdict.accepted) {
    share_predicted_targets();
    navigation_.on_frame(frame, verdict.acquired_time_ns, now_ns);
    probe_.store(navigation_.probe());
  }
  return verdict.accepted;
}

void Engine::tick_navigation(std::int64_t now_ns) noexcept {
  share_predicted_targets();
  navigation_.on_tick(now_ns);
  probe_.store(navigation_.probe());
}

void Engine::share_predicted_targets() noexcept {
  if (predicted_.load_newer(targets_, seen_targets_)) {
    navigation_.on(targets_);
  }
}

void Engine::share_tracker_health(std::int64_t now_ns) noexcept {
  tracker_health_.store(tracker_border_.health(now_ns));
  TrackingView view;
  view.reference_visible = navigation_.reference_visible();
  for (const wire::NavigationState &state : navigation_.states()) {
    TrackingView::Tool &tool = view.tools[view.tool_count++];
    copy_name(tool.tool, state.tool);
    tool.status = state.status;
    tool.planned = state.trajectory[0] != '\0';
    tool.age_ns = state.age_ns;
  }
  tracking_.store(view);
}

// ---- sensors ----

bool Engine::take(const wire::RobotState &sample, std::uint64_t writer, std::int64_t now_ns) noexcept {
  return robot_border_.check(sample, writer, now_ns).accepted;
}

bool Engine::take(const wire::RangeSample &sample, std::uint64_t writer, std::int64_t now_ns) noexcept {
  return range_border_.check(sample, writer, now_ns).accepted;
}

bool Engine::take(const wire::ForceSample &sample, std::uint64_t writer, std::int64_t now_ns) noexcept {
  const bool accepted = force_border_.check(sample, writer, now_ns).accepted;
  if (accepted) {
    ForceView view{.arrived_ns = now_ns};
    std::copy_n(sample.force_N, 3, view.force_N);
    force_.store(view);
  }
  return accepted;
}

void Engine::sensor_writers(std::uint32_t robots, std::uint32_t ranges, std::uint32_t forces) noexcept {
  robot_border_.set_writers_alive(robots);
  range_border_.set_writers_alive(ranges);
  force_border_.set_writers_alive(forces);
}

void Engine::share_sensor_health(std::int64_t now_ns) noexcept {
  inputs::StreamHealth health = robot_border_.health(now_ns);
  inputs::add_to(health, range_border_.health(now_ns));
  inputs::add_to(health, force_border_.health(now_ns));
  sensor_health_.store(health);
}

// ---- registration, monitoring, deformation ----

const RegistrationPipeline &Engine::step_registration(std::int64_t now_ns) noexcept {
  RegistrationInput input;
  while (to_registration_.ring.try_pop(input)) {
    registration_.handle(input);
  }
  if (search_answer_.load_newer(answer_, seen_answer_)) {
    registration_.on(answer_);
  }
  registration_.step(now_ns);
  if (const PoseRecoveryRequest *wanted = registration_.wanted_search()) {
    search_request_.store(*wanted);
  }
  registration_state_.store(registration_.state());
  taken_generation_[kRegistration].store(registration_.case_generation(), std::memory_order_release);
  return registration_;
}

const wire::AccuracyState &Engine::step_monitoring(const recording::RecorderStatus &recorder, std::uint64_t overruns,
                                                   std::int64_t now_ns) noexcept {
  MonitoringInput input;
  while (to_monitoring_.ring.try_pop(input)) {
    monitoring_.handle(input);
  }
  taken_generation_[kMonitoring].store(monitoring_.case_generation(), std::memory_order_release);
  (void)tracking_.load_newer(monitoring_view_.tracking, seen_by_monitoring_[0]);
  (void)tracker_health_.load_newer(monitoring_view_.trackers, seen_by_monitoring_[1]);
  (void)sensor_health_.load_newer(monitoring_view_.sensors, seen_by_monitoring_[2]);
  (void)registration_state_.load_newer(monitoring_view_.registration, seen_by_monitoring_[3]);
  monitoring_view_.recorder = recorder;
  monitoring_view_.overruns = overruns;
  monitoring_.step(monitoring_view_, now_ns);
  return monitoring_.accuracy();
}

const DeformationPipeline &Engine::step_deformation(std::int64_t now_ns, int most_steps) noexcept {
  CaseChanged change{};
  while (to_deformation_.ring.try_pop(change)) {
    deformation_.handle(change);
    ready_ = {};
  }
  (void)tissue_model_.load_newer(ready_, seen_by_deformation_[0]);
  if (ready_.generation == deformation_.case_generation() && ready_.generation != 0) {
    deformation_.handle(ready_);
    ready_ = {};
  }
  (void)probe_.load_newer(probe_view_, seen_by_deformation_[1]);
  (void)force_.load_newer(force_view_, seen_by_deformation_[2]);
  taken_generation_[kDeformation].store(deformation_.case_generation(), std::memory_order_release);
  deformation_.step(probe_view_, force_view_, now_ns, most_steps);
  predicted_.store(deformation_.predicted());
  return deformation_;
}

std::string Engine::step_tissue_builder() {
  CaseChanged change{};
  while (to_tissue_builder_.ring.try_pop(change)) {
    tissue_builder_.handle(change);
  }
  tissue_builder_.free_before(taken_generation_[kDeformation].load(std::memory_order_acquire));
  std::string line;
  if (const auto ready = tissue_builder_.build()) {
    tissue_model_.store(*ready);
    line = ready->model == nullptr
               ? tissue_builder_.why()
               : "tissue model of " + std::to_string(ready->model->solver().elements()) + " tetrahedra, step " +
                     std::to_string(1e3 * ready->model->solver().step_s()) + " ms";
  }
  taken_generation_[kTissueBuilder].store(tissue_builder_.case_generation(), std::memory_order_release);
  return line;
}

void Engine::step_pose_recovery() {
  CaseChanged change{};
  while (to_pose_recovery_.ring.try_pop(change)) {
    pose_recovery_.handle(change);
  }
  taken_generation_[kPoseRecovery].store(pose_recovery_.case_generation(), std::memory_order_release);
  request_waits_ = search_request_.load_newer(request_, seen_request_) || request_waits_;
  if (request_waits_ && request_.generation <= pose_recovery_.case_generation()) {
    request_waits_ = false;
    if (const auto answer = pose_recovery_.answer(request_)) {
      search_answer_.store(*answer);
    }
  }
}

void Engine::add_devices(wire::SystemHealth &health) const {
  for (const auto *stream : {&tracker_health_, &sensor_health_}) {
    if (const auto latest = stream->load()) {
      inputs::add_to(health, *latest);
    }
  }
}

} // namespace bregma::server
