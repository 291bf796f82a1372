#include "drivers/sim/simulated_room.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include "drivers/sim/faults.hpp"
#include "drivers/sim/operator.hpp"
#include "drivers/sim/optical_tracker.hpp"
#include "drivers/sim/patient.hpp"
#include "drivers/sim/robot_arm.hpp"
#include "drivers/sim/sensors.hpp"
#include "idl/names.hpp"

namespace bregma::sim {

namespace {

std::int64_t ns_of_ms(double milliseconds) { return std::llround(milliseconds * 1e6); }

// Times with a constant period, without drift from rounding.
class Ticker {
public:
  explicit Ticker(double rate_hz) : period_ns_(1e9 / rate_hz) {}
  void start(std::int64_t at_ns) { origin_ns_ = at_ns; }
  [[nodiscard]] std::int64_t next_ns() const { return origin_ns_ + std::llround(elapsed_ns_); }
  void step(double faster = 1.0) { elapsed_ns_ += period_ns_ / faster; }
  [[nodiscard]] std::int64_t period_ns() const { return std::llround(period_ns_); }

private:
  double period_ns_;
  double elapsed_ns_ = 0.0;
  std::int64_t origin_ns_ = 0;
};

// The part of the case that the operator needs, without meshes other than the scalp.
casefile::Case without_structures(const casefile::Case &a_case) {
  casefile::Case out = a_case;
  out.brain = {};
  out.structures.clear();
  return out;
}

const TrueTool *first_probe(const Patient &patient) {
  const auto found = std::find_if(patient.tools.begin(), patient.tools.end(),
                                  [](const TrueTool &tool) { return tool.model.role == casefile::ToolRole::kProbe; });
  return found == patient.tools.end() ? nullptr : &*found;
}

} // namespace

void RoomOutput::clear() {
  frames.clear();
  truths.clear();
  robot_states.clear();
  force_samples.clear();
  range_samples.clear();
  commands.clear();
  events.clear();
}

struct SimulatedRoom::State {
  State(const casefile::Case &the_case, const Scenario &the_scenario, std::uint64_t the_seed)
      : seed(the_seed), a_case(without_structures(the_case)), scenario(the_scenario),
        patient(a_case, scenario.patient, seed), arm(patient, scenario.robot, seed),
        person(a_case, scenario, patient, arm, seed), tracker(patient, scenario.tracker, seed),
        clock(scenario.tracker, seed), force(the_case.brain.mesh, scenario.tissue, scenario.sensors, seed),
        range(patient, scenario.sensors, seed), faults(scenario.faults), delays(seed, "delays"), losses(seed, "losses"),
        bumps(seed, "bumps"), probe(first_probe(patient)), tracker_ticker(scenario.tracker.rate_hz),
        operator_ticker(1e9 / Operator::kTick_ns), robot_ticker(scenario.robot.rate_hz),
        force_ticker(scenario.sensors.force_rate_hz), range_ticker(scenario.sensors.range_rate_hz) {}

  void start(std::int64_t now_ns);
  void run_operator(std::int64_t time_ns, RoomOutput &out);
  void apply_faults(std::int64_t time_ns);
  void expose(std::int64_t time_ns, RoomOutput &out);
  void deliver(const wire::TrackerFrame &frame);
  [[nodiscard]] wire::SimulatedTruth truth(std::int64_t time_ns) const;
  template <class Sample>
  void stamp(Sample &sample, const char *device, std::uint64_t frame, std::int64_t time_ns, const Ticker &ticker);

  std::uint64_t seed;
  casefile::Case a_case;
  Scenario scenario;
  Patient patient;
  RobotArm arm;
  Operator person;
  OpticalTracker tracker;
  DeviceClock clock;
  ForceSensor force;
  RangeSensor range;
  FaultSchedule faults;
  Random delays, losses, bumps;
  const TrueTool *probe;

  Ticker tracker_ticker, operator_ticker, robot_ticker, force_ticker, range_ticker;
  bool started = false;
  std::uint64_t tracker_frame = 0, robot_frame = 0, force_frame = 0, range_frame = 0;
  std::deque<wire::TrackerFrame> in_flight;           // in the order of delivery, at sent_time_ns
  std::deque<std::pair<BadSample, std::int64_t>> bad; // kinds and remaining counts
};

template <class Sample>
void SimulatedRoom::State::stamp(Sample &sample, const char *device, std::uint64_t frame, std::int64_t time_ns,
                                 const Ticker &ticker) {
  (void)wire::set_name(sample.device, device);
  sample.frame = frame;
  sample.device_time_ns = time_ns;
  sample.sent_time_ns = time_ns;
  sample.period_ns = ticker.period_ns();
}

void SimulatedRoom::State::start(std::int64_t now_ns) {
  started = true;
  for (Ticker *ticker : {&tracker_ticker, &operator_ticker, &robot_ticker, &force_ticker, &range_ticker}) {
    ticker->start(now_ns);
  }
  faults.start(now_ns);
}

void SimulatedRoom::State::run_operator(std::int64_t time_ns, RoomOutput &out) {
  const std::size_t known = out.events.size();
  person.tick(time_ns, out);
  for (std::size_t i = known; i < out.events.size(); ++i) {
    if (out.events[i].kind == StepEvent::Kind::kStarted) {
      faults.step_started(out.events[i].step, time_ns);
    }
  }
}

void SimulatedRoom::State::apply_faults(std::int64_t time_ns) {
  while (const Fault *fault = faults.take_due(time_ns)) {
    if (fault->kind == FaultKind::kReferenceBump) {
      patient.bump_reference(fault->vector_mm.value_or(fault->magnitude_mm * bumps.direction()));
    } else if (fault->kind == FaultKind::kClockJump) {
      clock.jump(ns_of_ms(fault->jump_ms));
    } else {
      bad.emplace_back(fault->sample, fault->count);
    }
  }
}

wire::SimulatedTruth SimulatedRoom::State::truth(std::int64_t time_ns) const {
  wire::SimulatedTruth out{};
  (void)wire::set_name(out.device, kTrackerDevice);
  (void)wire::set_name(out.step, person.label());
  out.frame = tracker_frame;
  out.time_ns = time_ns;
  out.seeded = true;
  out.seed = seed;
  out.T_image_reference = wire::to_wire(patient.T_image_reference);
  for (std::size_t i = 0; i < patient.tools.size() && i < bregma_wire_MAX_TOOLS; ++i) {
    const T_ImageTip T_image_tip = person.true_tip(i, time_ns);
    wire::TrueTool &tool = out.tools[out.tool_count++];
    (void)wire::set_name(tool.tool, patient.tools[i].model.name);
    tool.T_image_tip = wire::to_wire(T_image_tip);
    tool.T_tracker_tool = wire::to_wire(patient.T_tracker_image * patient.tools[i].body(T_image_tip));
  }
  return out;
}

void SimulatedRoom::State::expose(std::int64_t time_ns, RoomOutput &out) {
  ++tracker_frame;
  const wire::SimulatedTruth &true_now = out.truths.emplace_back(truth(time_ns));
  wire::TrackerFrame frame{};
  stamp(frame, kTrackerDevice, tracker_frame, time_ns, tracker_ticker);
  frame.device_time_ns = clock.stamp(time_ns);
  for (std::size_t i = 0; i < true_now.tool_count; ++i) {
    const auto T_tracker_tool = wire::from_wire<frame::Tracker, frame::Tool>(true_now.tools[i].T_tracker_tool);
    const bool covered = faults.occluded(patient.tools[i].model.name, time_ns);
    frame.tools[frame.tool_count++] = tracker.measure(patient.tools[i], T_tracker_tool, covered);
  }
  const TrackerParameters &p = scenario.tracker;
  const std::int64_t delay_ns = ns_of_ms(p.delay_ms + delays.exponential(p.delay_jitter_ms));
  const bool lost = losses.uniform(0.0, 1.0) < p.missing_share;
  if (lost || faults.tracker_silent(time_ns)) {
    return;
  }
  frame.sent_time_ns = time_ns + delay_ns;
  if (!in_flight.empty()) { // one line: samples keep their order
    frame.sent_time_ns = std::max(frame.sent_time_ns, in_flight.back().sent_time_ns);
  }
  deliver(frame);
}

void SimulatedRoom::State::deliver(const wire::TrackerFrame &frame) {
  if (bad.empty()) {
    in_flight.push_back(frame);
    return;
  }
  const BadSample kind = bad.front().first;
  if (--bad.front().second == 0) {
    bad.pop_front();
  }
  if (!replaces(kind)) {
    in_flight.push_back(frame);
  }
  in_flight.push_back(spoiled(frame, kind));
}

SimulatedRoom::SimulatedRoom(const casefile::Case &a_case, const Scenario &scenario, std::uint64_t seed)
    : state_(std::make_unique<State>(a_case, scenario, seed)) {}
SimulatedRoom::~SimulatedRoom() = default;
SimulatedRoom::SimulatedRoom(SimulatedRoom &&) noexcept = default;
SimulatedRoom &SimulatedRoom::operator=(SimulatedRoom &&) noexcept = default;

void SimulatedRoom::advance(std::int64_t now_ns, RoomOutput &out) {
  State &s = *state_;
  out.clear();
  if (!s.started) {
    s.start(now_ns);
  }
  const std::array<Ticker *, 5> tickers{&s.operator_ticker, &s.robot_ticker, &s.tracker_ticker, &s.force_ticker,
                                        &s.range_ticker};
  for (;;) {
    Ticker *const next = *std::min_element(tickers.begin(), tickers.end(), [](const Ticker *a, const Ticker *b) {
      return a->next_ns() < b->next_ns(); // the first of equal ones: the hand moves before it is measured
    });
    const std::int64_t time_ns = next->next_ns();
    if (time_ns > now_ns) {
      break;
    }
    s.apply_faults(time_ns);
    const auto step = [&s, next, time_ns](const char *device) { next->step(s.faults.rate_factor(device, time_ns)); };
    if (next == &s.operator_ticker) {
      s.run_operator(time_ns, out);
      next->step();
    } else if (next == &s.tracker_ticker) {
      s.expose(time_ns, out);
      step(kTrackerDevice);
    } else if (next == &s.robot_ticker) {
      s.stamp(out.robot_states.emplace_back(s.arm.sample(time_ns)), kRobotDevice, ++s.robot_frame, time_ns, *next);
      step(kRobotDevice);
    } else if (next == &s.force_ticker) {
      const auto index = s.probe == nullptr ? 0 : static_cast<std::size_t>(s.probe - s.patient.tools.data());
      const auto sample = s.force.sample(s.probe, s.person.true_tip(index, time_ns), time_ns);
      s.stamp(out.force_samples.emplace_back(sample), kForceDevice, ++s.force_frame, time_ns, *next);
      step(kForceDevice);
    } else {
      if (const auto sample = s.range.sample(s.arm.flange())) {
        s.stamp(out.range_samples.emplace_back(*sample), kRangeDevice, ++s.range_frame, time_ns, *next);
      }
      step(kRangeDevice);
    }
  }
  while (!s.in_flight.empty() && s.in_flight.front().sent_time_ns <= now_ns) {
    out.frames.push_back(s.in_flight.front());
    s.in_flight.pop_front();
  }
}

std::int64_t SimulatedRoom::next_due_ns() const {
  const State &s = *state_;
  const std::int64_t next = std::min({s.tracker_ticker.next_ns(), s.operator_ticker.next_ns(), s.robot_ticker.next_ns(),
                                      s.force_ticker.next_ns(), s.range_ticker.next_ns()});
  return s.in_flight.empty() ? next : std::min(next, s.in_flight.front().sent_time_ns);
}

void SimulatedRoom::on_reply(const wire::CommandReply &reply) { state_->person.on_reply(reply); }

void SimulatedRoom::on_navigation(const wire::NavigationState &state, std::int64_t now_ns) {
  state_->person.on_navigation(state, now_ns);
}

bool SimulatedRoom::finished() const { return state_->person.finished(); }
bool SimulatedRoom::failed() const { return state_->person.failed(); }
std::string SimulatedRoom::failure() const { return state_->person.failure(); }
std::string SimulatedRoom::current_step() const { return state_->person.label(); }
void SimulatedRoom::continue_with(std::vector<Step> steps) { state_->person.continue_with(std::move(steps)); }

} // namespace bregma::sim
