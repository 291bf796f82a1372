#include "tests/support/virtual_operation.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <unistd.h>

#include "idl/names.hpp"
#include "server/stages/session/stage.hpp"
#include "server/stages/tissue_model/stage.hpp"

namespace bregma::test {
namespace {

constexpr std::int64_t kStart_ns = 1'800'000'000'000'000'000; // a time in 2027
constexpr std::size_t kKeptTruths = 256; // more than the number of frames between exposure and delivery
constexpr int kSolverSteps = 100;        // steps of the tissue model per period, more than it needs

server::Config with_state(server::Config config, const std::filesystem::path &folder) {
  std::string &directory = config.stages.of<server::SessionParameters>().state_directory;
  if (directory.empty()) {
    directory = folder.string();
  }
  return config;
}

} // namespace

server::Config quick_config() {
  server::Config config;
  config.stages.of<server::TissueModelParameters>().elements = 0;
  return config;
}

VirtualOperation::VirtualOperation(const casefile::Case &a_case, const sim::Scenario &scenario, std::uint64_t seed,
                                   server::Config config)
    : room_(a_case, scenario, seed), config_(with_state(std::move(config), folder_.path())),
      wiring_(std::make_unique<server::Wiring>(config_.stages, topics_, static_cast<server::Host &>(*this))),
      loops_(wiring_->stages(), topics_, kStart_ns), link_(kStart_ns), now_ns_(kStart_ns) {
  topics_.observe<wire::NavigationState>([this](const wire::NavigationState &state) { on_state(state); });
  topics_.observe<wire::CommandReply>([this](const wire::CommandReply &reply) {
    replies_.push_back(reply);
    room_.on_reply(reply);
  });
  topics_.observe<wire::Alarm>([this](const wire::Alarm &alarm) { alarms_.push_back(alarm); });
  topics_.observe<wire::RegistrationState>([this](const auto &sample) { registration_ = sample; });
  topics_.observe<wire::FiducialReport>([this](const auto &sample) { fiducials_ = sample; });
  topics_.observe<wire::AccuracyState>([this](const auto &sample) { accuracy_ = sample; });
  topics_.observe<wire::SystemHealth>([this](const auto &sample) { health_ = sample; });
}

VirtualOperation::~VirtualOperation() = default;

std::optional<int> VirtualOperation::fixed_solver_steps() const noexcept { return kSolverSteps; }

bool VirtualOperation::run(double limit_s) {
  const std::int64_t end_ns = now_ns_ + static_cast<std::int64_t>(limit_s * 1e9);
  sim::RoomOutput out;
  loops_.begin();
  while (!room_.finished()) {
    before_advance_(now_ns_);
    link_.arrive(now_ns_);
    room_.advance(now_ns_, out);
    deliver(out);
    if (daemon_runs()) {
      if (std::exchange(killed_, false)) {
        start_killed_daemon();
      }
      process_alarms_.update(process_facts_, now_ns_);
      loops_.advance(now_ns_);
    }
    if (now_ns_ >= end_ns) {
      timed_out_ = true;
      return false;
    }
    const std::int64_t line_ns = line_ != nullptr ? line_->next_due_ns() : server::Stage::kNever;
    const std::int64_t daemon_ns = daemon_runs() ? loops_.next_due_ns() : stopped_until_ns_;
    now_ns_ = std::max(now_ns_ + 1, std::min({room_.next_due_ns(), daemon_ns, line_ns, link_.next_arrival_ns()}));
  }
  return !room_.failed();
}

void VirtualOperation::kill_daemon(std::int64_t restart_ns) {
  stopped_until_ns_ = restart_ns;
  killed_ = true;
}

void VirtualOperation::start_killed_daemon() {
  wiring_.reset();
  topics_.disconnect();
  wiring_ = std::make_unique<server::Wiring>(config_.stages, topics_, static_cast<server::Host &>(*this));
  loops_.restart(wiring_->stages(), now_ns_);
}

const std::string &VirtualOperation::state_directory() {
  return config_.stages.of<server::SessionParameters>().state_directory;
}

std::string VirtualOperation::failure() const {
  return timed_out_ ? "step " + room_.current_step() + " did not end in time" : room_.failure();
}

void VirtualOperation::deliver(sim::RoomOutput &out) {
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
  const auto stamp = [this](auto &samples) {
    for (auto &sample : samples) {
      link_.stamp(sample, now_ns_);
    }
  };
  stamp(out.frames);
  stamp(out.robot_states);
  stamp(out.range_samples);
  stamp(out.force_samples);
  received_frames_ += out.frames.size();
  if (line_ != nullptr) {
    line_->carry(out, now_ns_, topics_);
    return;
  }
  const auto put = [this](const auto &samples) {
    for (const auto &sample : samples) {
      topics_.put(sample);
    }
  };
  const auto send = [this](const auto &samples) {
    for (const auto &sample : samples) {
      link_.send(sample, now_ns_, [this](const auto &arrived) { topics_.put(arrived); });
    }
  };
  send(out.frames);
  send(out.robot_states);
  send(out.range_samples);
  send(out.force_samples);
  put(out.commands);
}

void VirtualOperation::on_state(const wire::NavigationState &state) {
  room_.on_navigation(state, now_ns_);
  if (observer_) {
    observer_(state, truth_of(state.frame));
  }
}

const wire::SimulatedTruth *VirtualOperation::truth_of(std::uint64_t frame) const {
  const auto found =
      std::find_if(truths_.rbegin(), truths_.rend(), [frame](const auto &truth) { return truth.frame == frame; });
  return found != truths_.rend() ? &*found : nullptr;
}

} // namespace bregma::test
