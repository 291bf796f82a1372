#include "tests/support/virtual_operation.hpp"

#include <algorithm>
#include <stdexcept>

#include <unistd.h>

#include "idl/names.hpp"

namespace bregma::test {
namespace {

constexpr std::int64_t kStart_ns = 1'800'000'000'000'000'000; // some day in 2027
constexpr std::int64_t kPoll_ns = 5'000'000;
constexpr std::int64_t kShare_ns = 100'000'000;
constexpr std::size_t kKeptTruths = 64; // more frames than are under way between exposure and delivery

std::int64_t period_ns(double rate_hz) { return static_cast<std::int64_t>(1e9 / rate_hz); }

constexpr int kSolverSteps = 100; // of the tissue model, in a step of its loop: time is virtual

// A state directory of its own, and no tissue model: it would take longer than all the rest.
server::Config with_state(server::Config config, const std::filesystem::path &folder) {
  config.deformation.elements = 0;
  if (config.state.directory.empty()) {
    config.state.directory = folder.string();
  }
  return config;
}

// Something that falls due at a fixed rate.
struct Due {
  std::int64_t period_ns;
  std::int64_t next_ns = kStart_ns;
  bool take(std::int64_t now_ns) {
    const bool due = now_ns >= next_ns;
    next_ns += due ? period_ns : 0;
    return due;
  }
};

} // namespace

TemporaryFolder::TemporaryFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "bregma-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) {
    throw std::runtime_error("cannot make a folder like " + name);
  }
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

VirtualOperation::VirtualOperation(const casefile::Case &a_case, const sim::Scenario &scenario, std::uint64_t seed,
                                   server::Config config)
    : room_(a_case, scenario, seed), config_(with_state(std::move(config), folder_.path())), engine_(config_, *this),
      now_ns_(kStart_ns) {}

bool VirtualOperation::run(double limit_s) {
  Due poll{kPoll_ns};
  Due share{kShare_ns};
  Due floor{period_ns(config_.navigation.floor_rate_hz)};
  Due registration{period_ns(config_.registration.rate_hz)};
  Due monitoring{period_ns(config_.monitoring.rate_hz)};
  const std::int64_t end_ns = now_ns_ + static_cast<std::int64_t>(limit_s * 1e9);
  sim::RoomOutput out;
  while (!room_.finished()) {
    room_.advance(now_ns_, out);
    deliver(out);
    if (floor.take(now_ns_) || now_ns_ >= engine_.navigation().next_change_ns()) {
      engine_.receive_navigation();
      engine_.tick_navigation(now_ns_);
      publish_states();
    }
    if (share.take(now_ns_)) {
      engine_.share_tracker_health(now_ns_);
      engine_.share_sensor_health(now_ns_);
    }
    if (registration.take(now_ns_)) {
      const server::RegistrationPipeline &pipeline = engine_.step_registration(now_ns_);
      engine_.step_pose_recovery();
      (void)engine_.step_tissue_builder();
      registration_ = pipeline.state();
      fiducials_ = pipeline.fiducials();
    }
    if (monitoring.take(now_ns_)) {
      accuracy_ = engine_.step_monitoring({}, 0, now_ns_);
      (void)engine_.step_deformation(now_ns_, kSolverSteps);
    }
    if (poll.take(now_ns_)) {
      engine_.poll(now_ns_);
    }
    give_replies();
    if (now_ns_ >= end_ns) {
      timed_out_ = true;
      return false;
    }
    now_ns_ = std::max(now_ns_ + 1,
                       std::min({room_.next_due_ns(), poll.next_ns, share.next_ns, floor.next_ns, registration.next_ns,
                                 monitoring.next_ns, engine_.navigation().next_change_ns()}));
  }
  return !room_.failed();
}

std::string VirtualOperation::failure() const {
  return timed_out_ ? "step " + room_.current_step() + " did not end in time" : room_.failure();
}

void VirtualOperation::deliver(const sim::RoomOutput &out) {
  for (const sim::StepEvent &event : out.events) {
    step_ = event.step;
    events_.push_back(event);
  }
  for (const wire::SimulatedTruth &truth : out.truths) {
    truths_.push_back(truth);
    if (truths_.size() > kKeptTruths) {
      truths_.pop_front();
    }
  }
  constexpr std::uint64_t kWriter = 1;
  for (const wire::TrackerFrame &frame : out.frames) {
    engine_.receive_navigation();
    ++received_frames_;
    if (engine_.take(frame, kWriter, now_ns_)) {
      publish_states();
    }
  }
  for (const auto &sample : out.robot_states) {
    (void)engine_.take(sample, kWriter, now_ns_);
  }
  for (const auto &sample : out.range_samples) {
    (void)engine_.take(sample, kWriter, now_ns_);
  }
  for (const auto &sample : out.force_samples) {
    (void)engine_.take(sample, kWriter, now_ns_);
  }
  for (const wire::Command &command : out.commands) {
    engine_.session().handle(command, now_ns_);
  }
}

void VirtualOperation::publish_states() {
  for (const wire::NavigationState &state : engine_.navigation().states()) {
    room_.on_navigation(state, now_ns_);
    if (observer_) {
      observer_(state, truth_of(state.frame));
    }
  }
}

const wire::SimulatedTruth *VirtualOperation::truth_of(std::uint64_t frame) const {
  const auto found =
      std::find_if(truths_.rbegin(), truths_.rend(), [frame](const auto &truth) { return truth.frame == frame; });
  return found != truths_.rend() ? &*found : nullptr;
}

void VirtualOperation::publish(const wire::CommandReply &reply) {
  replies_.push_back(reply);
  all_replies_.push_back(reply);
}

void VirtualOperation::give_replies() {
  while (!replies_.empty()) {
    const wire::CommandReply reply = replies_.front();
    replies_.pop_front();
    room_.on_reply(reply);
  }
}

wire::SystemHealth VirtualOperation::health() const {
  wire::SystemHealth health{};
  engine_.add_devices(health);
  return health;
}

} // namespace bregma::test
