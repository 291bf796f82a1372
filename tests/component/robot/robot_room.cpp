#include "tests/component/robot/robot_room.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <utility>

#include <unistd.h>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "server/stages/session/stage.hpp"
#include "server/stages/tissue_model/stage.hpp"
#include "tests/support/arm_wire.hpp"
#include "tests/support/measured_markers.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/robot/arms.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::test {

namespace {

using geometry::Vector3d;

constexpr std::int64_t kStart_ns = 1'800'000'000'000'000'000;
constexpr double kScan_mm = 180.0; // height of the beam's origin over the face

// The face before the arm: anterior against the flange's z, the patient's right along its x. Where the beam is kScan_mm
// long, it meets the face beside the nose.
geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::Image>
place_head(const robot::FlangePose &flange, const Vector3d &beam_origin, std::mt19937 &rng) {
  Eigen::Matrix3d axes; // of Image in the flange
  axes.col(0) = Vector3d::UnitX();
  axes.col(1) = -Vector3d::UnitZ();
  axes.col(2) = Vector3d::UnitX().cross(-Vector3d::UnitZ());
  const Eigen::Quaterniond tilt = geometry::rotation_exp(normal_vector(rng, 0.05));
  const Eigen::Quaterniond R = (flange.rotation() * Eigen::Quaterniond(axes) * tilt).normalized();
  const Vector3d middle = on_head(Vector3d(0.0, 0.95, 0.1));
  const Vector3d there = flange * (beam_origin + kScan_mm * Vector3d::UnitZ());
  return {R, there - R * middle};
}

server::Config config_for(const std::filesystem::path &state) {
  server::Config out;
  out.stages.of<server::TissueModelParameters>().elements = 0;
  out.stages.of<server::SessionParameters>().state_directory = state.string();
  out.stages.of<server::SessionParameters>().check_valid_min = RobotRoom::kCheckValid_min;
  out.stages.of<server::NavigationParameters>().latency_ms = 1e-6 * RobotRoom::kStep_ns; // from exposure to write
  return out;
}

} // namespace

std::function<void(wire::RobotState &)> RobotRoom::frozen_values() const {
  return [frozen = last_state_](wire::RobotState &state) {
    wire::RobotState repeated = frozen;
    repeated.frame = state.frame;
    repeated.device_time_ns = state.device_time_ns;
    repeated.sent_time_ns = state.sent_time_ns;
    repeated.sent_boot_ns = state.sent_boot_ns;
    state = repeated;
  };
}

// The driver's side of the wire.
class RobotRoom::ArmBus final : public ArmWire {
public:
  explicit ArmBus(RobotRoom &room) : room_(room) {}
  bool write(std::string_view topic, const void *sample) override {
    if (topic == wire::Topic<wire::RobotState>::kName && !room_.deliver_arm) {
      ++room_.undelivered;
    } else if (topic == wire::Topic<wire::RobotState>::kName) {
      wire::RobotState state = *static_cast<const wire::RobotState *>(sample);
      room_.tamper(state);
      room_.last_state_ = state;
      room_.topics_.put(state, room_.arm_writer);
    } else if (topic == wire::Topic<wire::RobotMotionState>::kName) {
      room_.motions.push_back(*static_cast<const wire::RobotMotionState *>(sample));
      room_.topics_.put(room_.motions.back(), room_.arm_writer);
    } else if (topic == wire::Topic<wire::CommandReply>::kName) {
      room_.replies_.push_back(*static_cast<const wire::CommandReply *>(sample));
      room_.topics_.put(room_.replies_.back());
    }
    return true;
  }

private:
  RobotRoom &room_;
};

class RobotRoom::RangeBus final : public driver::Bus {
public:
  explicit RangeBus(RobotRoom &room) : room_(room) {}
  bool write(std::string_view topic, const void *sample) override {
    if (topic == wire::Topic<wire::RangeSample>::kName) {
      room_.topics_.put(*static_cast<const wire::RangeSample *>(sample));
    }
    return true;
  }
  void take(std::string_view /*topic*/, const std::function<void(const void *)> & /*visit*/) override {}
  [[nodiscard]] std::uint32_t matched(std::string_view /*topic*/) const override { return 1; }

private:
  RobotRoom &room_;
};

RobotRoom::RobotRoom(const RobotCase &a_case, std::uint64_t seed)
    : case_(a_case), now_(kStart_ns), link_(kStart_ns), config_(config_for(folder_.path())),
      wiring_(std::make_unique<server::Wiring>(config_.stages, topics_, static_cast<server::Host &>(*this))),
      loops_(wiring_->stages(), topics_, kStart_ns), head_(a_case.loaded().scalp.mesh, 0.3, 15.0, seed),
      arm_(mz07f(), mz07f(), arm_settings()), arm_bus_(std::make_unique<ArmBus>(*this)),
      arm_io_(*arm_bus_, *this, arm_status_, {.device = "Robot"}), terminal_link_((folder_.path() / "range").string()),
      analogue_(
          {}, [this](std::int64_t) { return beam_target(); }, seed),
      range_bus_(std::make_unique<RangeBus>(*this)), range_io_(*range_bus_, *this, range_status_, {.device = "Range"}) {
  std::mt19937 rng(static_cast<unsigned>(seed) + 7);
  T_base_image_ = place_head(arm_.true_flange(), case_.beam_origin_mm(), rng);
  patient_ = sim::MovingHead(T_base_image_, kHeadCentre);
  T_image_reference_ = {geometry::rotation_exp(Vector3d(0.4, 0.1, -0.2)), kHeadCentre + Vector3d(110.0, 40.0, 90.0)};
  tracker_noise_.seed(static_cast<unsigned>(seed) + 23);

  base::ParameterSet arm_parameters("bregma-arm");
  arm_driver_.declare(arm_parameters);
  base::ParameterSet range_parameters("bregma-range");
  range_driver_.declare(range_parameters);
  const bool set = arm_parameters.set_from_string("address=" + socket_.address()) &&
                   arm_parameters.set_from_string("tool=Pointer") && arm_parameters.set_from_string("sigma_mm=0.1") &&
                   arm_parameters.set_from_string("sigma_mrad=0.2") &&
                   range_parameters.set_from_string("address=serial://" + terminal_link_) &&
                   range_parameters.set_from_string("serial_number=A4");
  driver::Settings settings;
  settings.device = "Robot";
  if (!set || !arm_driver_.prepare(settings) || !range_driver_.prepare({})) {
    throw std::runtime_error("the drivers do not take their parameters");
  }
  topics_.observe<wire::Alarm>([this](const wire::Alarm &alarm) { alarms.push_back(alarm); });
  topics_.observe<wire::NavigationState>([this](const wire::NavigationState &state) {
    if (wire::view(state.tool) == "Pointer") {
      states.push_back(state);
    }
  });
  topics_.observe<wire::CommandReply>([this](const wire::CommandReply &reply) { replies_.push_back(reply); });
  topics_.observe<wire::Command>([this](const wire::Command &command) {
    if (deliver_commands) {
      arm_bus_->commands.push_back(command);
    }
  });
  topics_.observe<wire::RobotPermit>([this](const wire::RobotPermit &permit) {
    if (deliver_permits) {
      arm_bus_->permits.push_back(permit);
    }
  });
  topics_.observe<wire::RobotPath>([this](const wire::RobotPath &path) { arm_bus_->paths.push_back(path); });
  topics_.observe<wire::AccuracyState>([this](const wire::AccuracyState &sample) { accuracy = sample; });
  topics_.observe<wire::RegistrationState>([this](const wire::RegistrationState &sample) {
    registration = sample;
    arm_bus_->registrations.push_back(sample);
  });
  topics_.observe<wire::SystemHealth>([this](const wire::SystemHealth &sample) {
    health = sample;
    arm_bus_->healths.push_back(sample);
  });
  topics_.observe<wire::SurfacePoints>([this](const wire::SurfacePoints &sample) {
    for (std::uint32_t i = 0; i + 2 < sample.xyz_mm._length; i += 3) {
      points.emplace_back(sample.xyz_mm._buffer[i], sample.xyz_mm._buffer[i + 1], sample.xyz_mm._buffer[i + 2]);
    }
    wire::SurfacePoints header = sample;
    header.xyz_mm = {};
    header.covariance_mm2 = {};
    header.time_ns = {};
    batches.push_back(header);
  });
  plug_sensor("A4");
  if (auto connected = arm_driver_.connect(arm_io_); !connected) {
    throw std::runtime_error(connected.error().message);
  }
  loops_.begin();
}

RobotRoom::~RobotRoom() {
  arm_driver_.disconnect();
  range_driver_.disconnect();
}

void RobotRoom::plug_sensor(const std::string &serial) {
  terminal_.reset();
  terminal_.emplace(sim::PseudoTerminal::open(terminal_link_).value());
  line_.emplace(
      range::Identity{"GP2Y0A21", serial, 12, 5000}, sim::RangeLineFaults{.missing_every = 50},
      [this](std::uint64_t time_us) {
        return analogue_.read_volts(static_cast<std::int64_t>(time_us) * 1'000, arm_.moving());
      },
      9);
}

sim::BeamTarget RobotRoom::beam_target() const {
  return sim::beam_on_head(head_, T_base_image_, arm_.true_flange(), {case_.beam_origin_mm(), case_.beam_direction()});
}

Vector3d RobotRoom::tip_in_image() const { return T_base_image_.inverse() * (flange() * case_.tip_mm()); }

Vector3d RobotRoom::axis_in_image() const {
  return T_base_image_.rotation().inverse() * (flange().rotation() * Vector3d::UnitZ());
}

double RobotRoom::tool_clearance_mm() const {
  const auto T_image_flange = T_base_image_.inverse() * flange();
  double out = std::numeric_limits<double>::infinity();
  for (double part = 0.0; part <= 1.0; part += 0.05) {
    out = std::min(out, head_.clearance_mm(T_image_flange * Vector3d(part * case_.tip_mm())));
  }
  return out;
}

std::size_t RobotRoom::replies_to(std::uint64_t id) const {
  return static_cast<std::size_t>(
      std::count_if(replies_.begin(), replies_.end(), [id](const auto &reply) { return reply.id == id; }));
}

RobotRoom::Flange RobotRoom::touching(const Vector3d &image_mm, double before_mm) const {
  const Eigen::Quaterniond R = flange().rotation();
  const Vector3d tip = T_base_image_ * image_mm - before_mm * (R * Vector3d::UnitZ());
  return {R, tip - R * case_.tip_mm()};
}

RobotRoom::Flange RobotRoom::above(const Vector3d &image_mm, double distance_mm) const {
  const Eigen::Quaterniond R = flange().rotation();
  return {R, T_base_image_ * image_mm - R * (case_.beam_origin_mm() + distance_mm * case_.beam_direction())};
}

std::vector<RobotRoom::Flange> RobotRoom::raster(double half_width_mm, double half_height_mm, double spacing_mm) const {
  const Eigen::Quaterniond R = flange().rotation();
  const Flange middle = above(on_head(Vector3d(0.0, 0.95, 0.1)), kScan_mm);
  std::vector<Flange> out;
  double side = 1.0;
  for (double x = -half_width_mm; x <= half_width_mm; x += spacing_mm, side = -side) {
    for (const double y : {-side * half_height_mm, side * half_height_mm}) {
      out.emplace_back(R, Vector3d(middle.translation() + R * Vector3d(x, y, 0.0)));
    }
  }
  return out;
}

void RobotRoom::serve_arm() {
  if (!arm_connected_ && socket_.accept(std::chrono::milliseconds(0))) {
    arm_connected_ = true;
    (void)socket_.send(arm_.connect());
  }
  if (arm_connected_) {
    // In this order: what the arm measures after a reset is no fault any more.
    const std::string answers = arm_.receive(socket_.receive_some(std::chrono::milliseconds(0)), now_);
    (void)socket_.send(answers + arm_.advance(now_));
  }
  if (const auto progress = arm_driver_.read(arm_io_); !progress) {
    throw std::runtime_error(progress.error().message);
  }
}

void RobotRoom::serve_range() {
  if (terminal_) {
    terminal_->write(line_->receive(terminal_->read(std::chrono::milliseconds(0))));
    terminal_->write(line_->advance(static_cast<std::uint64_t>((now_ - kStart_ns) / 1'000 + 1'000'000)));
  }
  if (!range_connected_) {
    if (now_ < range_retry_ns_) {
      return;
    }
    range_io_.start_connection();
    const auto connected = range_driver_.connect(range_io_);
    range_connected_ = connected.has_value();
    if (!connected) {
      range_error = connected.error().message;
      range_driver_.disconnect();
      range_retry_ns_ = now_ + 500'000'000;
    }
    return;
  }
  if (const auto progress = range_driver_.read(range_io_); !progress) {
    range_error = progress.error().message;
    range_driver_.disconnect();
    range_connected_ = false;
    range_retry_ns_ = now_ + 500'000'000;
  }
}

void RobotRoom::move_patient(const geometry::Vector6d &to, double seconds) { patient_.move(to, seconds, now_); }

void RobotRoom::place_patient() {
  const sim::BaseImage there = patient_.at(now_);
  T_base_image_ = {there.rotation(), there.translation() - push_mm_};
}

// 62.5 frames per second; a frame arrives a step after its exposure.
void RobotRoom::serve_tracker() {
  if (case_.loaded().hand_eye() == nullptr) {
    return;
  }
  if (exposed_) {
    link_.stamp(*exposed_, now_);
    if (deliver_tracker) {
      topics_.put(*exposed_);
    }
    exposed_.reset();
    return;
  }
  const auto seen_from = [&](const auto &T_base_body) {
    const auto T = case_.T_base_tracker().inverse() * T_base_body;
    return geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool>(
        T.rotation(), T.translation() + bump_mm_ + case_.T_base_tracker().inverse().rotation() * push_mm_);
  };
  wire::TrackerFrame frame{};
  (void)wire::set_name(frame.device, "Tracker");
  frame.frame = ++tracker_frame_;
  frame.device_time_ns = now_;
  frame.period_ns = 2 * kStep_ns;
  const auto add = [&](const casefile::ToolModel &model, const auto &T_base_body, bool hidden) {
    const wire::TrackedTool seen = measured_markers(model, seen_from(T_base_body), {}, tracker_noise_);
    if (!hidden) {
      frame.tools[frame.tool_count++] = seen;
    }
  };
  add(*case_.loaded().reference(), T_base_image_ * T_image_reference_, hide_reference);
  add(*case_.loaded().tool("Marker"), arm_.true_flange() * case_.T_flange_body(), hide_flange_body);
  exposed_ = frame;
}

void RobotRoom::step() {
  now_ += kStep_ns;
  place_patient();
  if (held_ != 0 && now_ >= next_deadman_ns_) {
    next_deadman_ns_ = now_ + 48'000'000;
    wire::RobotDeadman deadman{};
    (void)wire::set_name(deadman.device, "Robot");
    (void)wire::set_name(deadman.client, "console");
    deadman.motion_id = held_;
    deadman.frame = ++deadman_frame_;
    deadman.held = true;
    arm_bus_->deadmen.push_back(deadman);
  }
  serve_arm();
  serve_tracker();
  serve_range();
  loops_.advance(now_);
}

bool RobotRoom::run(double seconds, const std::function<bool()> &until) {
  for (const std::int64_t end = now_ + static_cast<std::int64_t>(1e9 * seconds); now_ < end;) {
    step();
    if (until()) {
      return true;
    }
  }
  return false;
}

wire::CommandReply RobotRoom::command(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
  wire::Command command{};
  if (const std::string wrong = wire::fill_command(command, kind, values); !wrong.empty()) {
    throw std::runtime_error(wrong);
  }
  (void)wire::set_name(command.client, "console");
  command.id = ++id_;
  command.sent_time_ns = now_;
  topics_.put(command);
  wire::CommandReply out{};
  wire::set_text(out.text, "no reply");
  (void)run(3.0, [&] {
    const auto found =
        std::find_if(replies_.begin(), replies_.end(), [&](const auto &reply) { return reply.id == command.id; });
    if (found == replies_.end()) {
      return false;
    }
    out = *found;
    return true;
  });
  return out;
}

void RobotRoom::start_move(const std::vector<Flange> &path, double speed_mm_s) {
  wire::Command command{};
  (void)wire::fill_command(command, bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "50", "5"});
  (void)wire::set_name(command.client, "console");
  (void)wire::set_name(command.receiver, "Robot");
  command.id = held_ = ++id_;
  arm_bus_->commands.push_back(command);
  wire::RobotPath out{};
  (void)wire::set_name(out.device, "Robot");
  (void)wire::set_name(out.client, "console");
  out.motion_id = held_;
  out.speed_mm_s = speed_mm_s;
  out.waypoint_count = static_cast<std::uint32_t>(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    out.T_base_flange[i] = wire::to_wire(path[i]);
  }
  arm_bus_->paths.push_back(out);
}

bool RobotRoom::move(const std::vector<Flange> &path, double speed_mm_s) {
  start_move(path, speed_mm_s);
  const std::uint64_t motion = held_;
  const bool done = run(300.0, [&] {
    return !motions.empty() && motions.back().motion_id == motion && motions.back().phase == bregma_wire_MOTION_DONE;
  });
  release_deadman();
  return done && run(0.2) == false; // the joints come to rest
}

bool RobotRoom::alarm_raised(std::string_view kind, std::string_view subject) const {
  return std::any_of(alarms.begin(), alarms.end(), [&](const wire::Alarm &alarm) {
    return wire::view(alarm.kind) == kind && wire::view(alarm.subject) == subject &&
           alarm.state == bregma_wire_ALARM_RAISED;
  });
}

bool RobotRoom::alarm_active(std::string_view kind) const {
  const auto last = std::find_if(alarms.rbegin(), alarms.rend(),
                                 [&](const wire::Alarm &alarm) { return wire::view(alarm.kind) == kind; });
  return last != alarms.rend() && last->state != bregma_wire_ALARM_CLEARED;
}

const wire::DeviceHealth *RobotRoom::device(std::string_view name) const {
  for (std::uint32_t i = 0; i < health.device_count; ++i) {
    if (wire::view(health.devices[i].device) == name) {
      return &health.devices[i];
    }
  }
  return nullptr;
}

} // namespace bregma::test
