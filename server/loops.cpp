#include "server/loops.hpp"

#include <algorithm>
#include <chrono>

#include <spdlog/spdlog.h>

namespace bregma::server {
namespace {

constexpr std::chrono::milliseconds kSearchInterval{50}; // at which a search or a model that is wanted is noticed
constexpr double kSolverShare = 0.7;                     // of the deformation loop's period, for the tissue solver
constexpr double kStepSmoothing = 0.1;
constexpr std::int64_t kShareInterval_ns = 100'000'000; // of device health towards monitoring and SystemHealth

std::int64_t period_ns(double rate_hz) { return static_cast<std::int64_t>(1e9 / rate_hz); }

runtime::LoopOptions periodic(const char *name, std::int64_t priority, double rate_hz) {
  return {{.name = name, .fifo_priority = static_cast<int>(priority)}, period_ns(rate_hz)};
}

// The solver computes for most of its period, and what it hands on may come a millisecond later.
runtime::LoopOptions computing(const char *name, std::int64_t priority, double rate_hz) {
  runtime::LoopOptions options = periodic(name, priority, rate_hz);
  options.thread.batch = true;
  return options;
}

void log_limits(const char *loop, const std::vector<std::string> &sentences) {
  for (const std::string &sentence : sentences) {
    spdlog::warn("{} loop: {}", loop, sentence);
  }
}

void add(wire::SystemHealth &health, const wire::LoopHealth &loop) {
  if (health.loop_count < bregma_wire_MAX_LOOPS) {
    health.loops[health.loop_count++] = loop;
  }
}

} // namespace

Loops::Loops(const Config &config, Engine &engine, const dds::Participant &participant, recording::Recorder &recorder,
             const runtime::Clock &clock)
    : config_(config), engine_(engine), recorder_(recorder), clock_(clock), stop_guard_(participant),
      navigation_channel_(recorder.channel("navigation")), navigation_states_(participant, navigation_channel_),
      frames_(participant), navigation_wait_(participant), sensor_channel_(recorder.channel("sensors")),
      robots_(participant), ranges_(participant), forces_(participant), sensor_wait_(participant),
      registration_states_(participant, recorder.channel("registration")),
      fiducial_reports_(participant, recorder.channel("registration")),
      accuracy_states_(participant, recorder.channel("monitoring")),
      deformation_states_(participant, recorder.channel("deformation")), fields_(participant),
      registration_loop_(periodic("registration", config.realtime.registration_priority, config.registration.rate_hz),
                         [this]() noexcept { step_registration(); }),
      monitoring_loop_(periodic("monitoring", config.realtime.monitoring_priority, config.monitoring.rate_hz),
                       [this]() noexcept { step_monitoring(); }),
      deformation_loop_(computing("deformation", config.realtime.deformation_priority, config.deformation.rate_hz),
                        [this]() noexcept { step_deformation(); }) {
  navigation_wait_.attach(frames_);
  navigation_wait_.attach(stop_guard_);
  sensor_wait_.attach(robots_);
  sensor_wait_.attach(ranges_);
  sensor_wait_.attach(forces_);
  sensor_wait_.attach(stop_guard_);
}

void Loops::start() {
  navigation_thread_ = std::thread([this] { navigate(); });
  sensor_thread_ = std::thread([this] { watch_sensors(); });
  search_thread_ = std::thread([this] { search_poses(); });
  tissue_thread_ = std::thread([this] { build_tissue_models(); });
  log_limits("registration", registration_loop_.start());
  log_limits("monitoring", monitoring_loop_.start());
  log_limits("deformation", deformation_loop_.start());
}

void Loops::stop() {
  stopping_.store(true, std::memory_order_relaxed);
  stop_guard_.raise();
  for (std::thread *thread : {&navigation_thread_, &sensor_thread_, &search_thread_, &tissue_thread_}) {
    if (thread->joinable()) {
      thread->join();
    }
  }
  registration_loop_.stop();
  monitoring_loop_.stop();
  deformation_loop_.stop();
}

// ---- navigation ----

void Loops::navigate() noexcept {
  log_limits("navigation",
             runtime::set_up_thread(
                 {.name = "navigation", .fifo_priority = static_cast<int>(config_.realtime.navigation_priority)}));
  runtime::DeadlineTicker floor(period_ns(config_.navigation.floor_rate_hz));
  floor.start(clock_.monotonic_ns());
  std::int64_t shared_ns = 0;

  while (!stopping_.load(std::memory_order_relaxed)) {
    const std::int64_t to_change_ns = engine_.navigation().next_change_ns() - clock_.now_ns();
    const std::int64_t to_floor_ns = floor.next_ns() - clock_.monotonic_ns();
    navigation_wait_.wait(std::chrono::nanoseconds(std::min(to_change_ns, to_floor_ns)));

    engine_.receive_navigation();
    take_frames();

    const std::int64_t now_ns = clock_.now_ns();
    const bool floor_due = floor.due(clock_.monotonic_ns());
    const bool change_due = now_ns >= engine_.navigation().next_change_ns();
    if (change_due || (floor_due && !published_)) {
      const runtime::TimedStep step(navigation_statistics_);
      engine_.tick_navigation(now_ns);
      publish_navigation(now_ns);
    }
    if (floor_due) {
      published_ = false;
      navigation_statistics_.count_overruns(floor.advance(clock_.monotonic_ns()));
    }
    if (now_ns - shared_ns >= kShareInterval_ns) {
      shared_ns = now_ns;
      engine_.share_tracker_health(now_ns);
    }
  }
}

void Loops::take_frames() noexcept {
  const std::size_t taken = frames_.take_each([this](const wire::TrackerFrame &frame, const dds::SampleInfo &info) {
    const runtime::TimedStep step(navigation_statistics_);
    const std::int64_t began_ns = clock_.monotonic_ns();
    const std::int64_t arrived_ns = clock_.now_ns();
    if (engine_.take(frame, info.writer, arrived_ns)) {
      publish_navigation(arrived_ns);
    }
    (void)navigation_channel_.push(arrived_ns, frame);
    if (frame.period_ns > 0 && clock_.monotonic_ns() - began_ns > frame.period_ns) {
      navigation_statistics_.count_overruns(1);
    }
  });
  // Also what a missed deadline or a lost writer woke us for: reading the status lets the wait set sleep again.
  if (taken == 0) {
    engine_.tracker_writers(frames_.status().writers_alive);
  }
}

void Loops::publish_navigation(std::int64_t now_ns) noexcept {
  for (const wire::NavigationState &state : engine_.navigation().states()) {
    navigation_states_(state, now_ns);
  }
  published_ = true;
}

// ---- sensors ----

void Loops::watch_sensors() noexcept {
  log_limits("sensors", runtime::set_up_thread({.name = "sensors"}));
  std::int64_t shared_ns = 0;
  const auto take = [this](const auto &sample, const dds::SampleInfo &info) {
    const runtime::TimedStep step(sensor_statistics_);
    const std::int64_t now_ns = clock_.now_ns();
    (void)engine_.take(sample, info.writer, now_ns); // the border counts what it refuses
    (void)sensor_channel_.push(now_ns, sample);
  };
  while (!stopping_.load(std::memory_order_relaxed)) {
    sensor_wait_.wait(std::chrono::nanoseconds(kShareInterval_ns));
    const std::size_t taken = robots_.take_each(take) + ranges_.take_each(take) + forces_.take_each(take);
    const std::int64_t now_ns = clock_.now_ns();
    const bool share = now_ns - shared_ns >= kShareInterval_ns;
    if (taken == 0 || share) {
      engine_.sensor_writers(robots_.status().writers_alive, ranges_.status().writers_alive,
                             forces_.status().writers_alive);
    }
    if (share) {
      shared_ns = now_ns;
      engine_.share_sensor_health(now_ns);
    }
  }
}

// ---- pose search ----

void Loops::search_poses() {
  log_limits("pose search", runtime::set_up_thread({.name = "pose search", .batch = true}));
  while (!stopping_.load(std::memory_order_relaxed)) {
    engine_.step_pose_recovery();
    std::this_thread::sleep_for(kSearchInterval);
  }
}

// ---- tissue models ----

void Loops::build_tissue_models() {
  log_limits("tissue model", runtime::set_up_thread({.name = "tissue model", .batch = true}));
  while (!stopping_.load(std::memory_order_relaxed)) {
    if (const std::string line = engine_.step_tissue_builder(); !line.empty()) {
      spdlog::info(line);
    }
    std::this_thread::sleep_for(kSearchInterval);
  }
}

// ---- periodic loops ----

void Loops::step_registration() noexcept {
  const std::int64_t now_ns = clock_.now_ns();
  const RegistrationPipeline &registration = engine_.step_registration(now_ns);
  registration_states_(registration.state(), now_ns);
  if (registration.estimated()) {
    fiducial_reports_(registration.fiducials(), now_ns);
  }
}

void Loops::step_monitoring() noexcept {
  const std::int64_t now_ns = clock_.now_ns();
  accuracy_states_(engine_.step_monitoring(recorder_.status(), overruns(), now_ns), now_ns);
}

void Loops::step_deformation() noexcept {
  const std::int64_t now_ns = clock_.now_ns();
  const std::int64_t began_ns = clock_.monotonic_ns();
  // As many steps as fit into most of the period; the model says when that is too few.
  const double budget_ns = kSolverShare * static_cast<double>(period_ns(config_.deformation.rate_hz));
  const int max_steps = solver_step_ns_ > 0.0 ? static_cast<int>(budget_ns / solver_step_ns_) : 1;
  const DeformationPipeline &deformation = engine_.step_deformation(now_ns, std::max(max_steps, 1));
  if (const int made = deformation.steps_made(); made > 0) {
    const double each_ns = static_cast<double>(clock_.monotonic_ns() - began_ns) / made;
    solver_step_ns_ = solver_step_ns_ > 0.0 ? solver_step_ns_ + kStepSmoothing * (each_ns - solver_step_ns_) : each_ns;
  }
  for (const wire::DeformationState &state : deformation.states()) {
    deformation_states_(state, now_ns);
  }
  publish_field(deformation, now_ns);
}

void Loops::publish_field(const DeformationPipeline &deformation, std::int64_t now_ns) noexcept {
  const tissue::BrainModel *model = deformation.model();
  const double rate_hz = config_.deformation.field_rate_hz;
  if (model == nullptr || rate_hz <= 0.0 || now_ns - field_ns_ < period_ns(rate_hz) || fields_.matched_readers() == 0) {
    return;
  }
  field_ns_ = now_ns;
  const auto nodes = static_cast<std::size_t>(model->solver().nodes());
  field_mm_.resize(3 * nodes); // allocates when a case's first field goes out, and not again
  for (std::size_t i = 0; i < nodes; ++i) {
    Eigen::Vector3f::Map(&field_mm_[3 * i]) = model->solver().displacement_mm(static_cast<int>(i)).cast<float>();
  }
  wire::DeformationField field{};
  (void)wire::set_name(field.model, "brain");
  field.time_ns = now_ns;
  field.status = deformation.states().empty() ? bregma_wire_DEFORMATION_NO_MODEL : deformation.states().front().status;
  field.displacement_mm._buffer = field_mm_.data();
  field.displacement_mm._length = field.displacement_mm._maximum = static_cast<std::uint32_t>(field_mm_.size());
  (void)fields_.write(field); // a field that DDS refuses is one that the next replaces
}

std::uint64_t Loops::overruns() const noexcept {
  return navigation_statistics_.overruns() + registration_loop_.statistics().overruns() +
         monitoring_loop_.statistics().overruns() + deformation_loop_.statistics().overruns();
}

void Loops::add_health(wire::SystemHealth &health) const {
  add(health, navigation_statistics_.health("navigation", 0.0));
  add(health, sensor_statistics_.health("sensors", 0.0));
  add(health, registration_loop_.health());
  add(health, monitoring_loop_.health());
  add(health, deformation_loop_.health());
}

std::vector<std::pair<std::string, std::function<std::uint64_t()>>> Loops::heartbeats() const {
  return {{"navigation", [this] { return navigation_statistics_.steps(); }},
          {"registration", [this] { return registration_loop_.statistics().steps(); }},
          {"monitoring", [this] { return monitoring_loop_.statistics().steps(); }},
          {"deformation", [this] { return deformation_loop_.statistics().steps(); }}};
}

} // namespace bregma::server
