#include "tests/unit/sim/room_fixture.hpp"

#include <cstring>
#include <stdexcept>

#include "idl/names.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::sim::test {

using Eigen::Vector3d;

casefile::Case make_case() {
  casefile::Case out;
  out.folder = "/cases/ellipsoid";
  out.id = "ellipsoid";
  out.scalp = {"scalp", bregma::test::make_head(4)};
  out.brain = {"brain", bregma::test::make_sphere(3, 60.0, bregma::test::kHeadCentre)};
  const std::vector<Vector3d> around{{-0.6, 0.8, 0.1}, {0.6, 0.8, 0.1},  {-0.8, 0.5, 0.5}, {0.8, 0.5, 0.5},
                                     {0.1, 0.8, 0.6},  {-0.3, 0.5, 0.8}, {0.4, 0.3, 0.9},  {0.9, 0.4, 0.1}};
  for (const Vector3d &direction : around) {
    out.fiducials.push_back({"F" + std::to_string(out.fiducials.size() + 1), bregma::test::on_head(direction)});
  }
  for (const Vector3d &direction : {Vector3d(0.0, 0.9, 0.1), Vector3d(-0.7, 0.6, 0.3), Vector3d(0.7, 0.5, 0.4)}) {
    out.landmarks.push_back({"L" + std::to_string(out.landmarks.size() + 1), bregma::test::on_head(direction)});
  }
  const Vector3d target = bregma::test::kHeadCentre + Vector3d(15, 0, 0);
  out.targets.push_back({"Deep", target});
  out.trajectories.push_back({"Biopsy", bregma::test::on_head(Vector3d(0.45, 0.45, 0.75)), target});
  casefile::ToolModel reference{
      .name = "Reference", .role = casefile::ToolRole::kReference, .markers_mm = {}, .axis = {0, -1, 0}};
  reference.markers_mm = {{0, 0, 0}, {98, 0, 0}, {22, 71, 0}, {71, 52, 0}};
  casefile::ToolModel stylus{
      .name = "Stylus", .role = casefile::ToolRole::kPointer, .markers_mm = {}, .nominal_tip_mm = {-150, 0, -12}};
  stylus.markers_mm = {{0, 0, 0}, {52, 31, 0}, {55, -27, 0}, {88, 6, 0}};
  casefile::ToolModel probe{
      .name = "Probe", .role = casefile::ToolRole::kProbe, .markers_mm = {}, .nominal_tip_mm = {-140, 0, -10}};
  probe.markers_mm = {{0, 0, 0}, {28, 47, 0}, {36, -41, 0}, {74, 35, 0}, {92, -18, 0}};
  out.tools = {reference, stylus, probe};
  return out;
}

Scenario scenario_of(const std::string &toml) {
  auto scenario = parse_scenario(toml, "test.toml");
  if (!scenario) {
    throw std::runtime_error(scenario.error().message);
  }
  return *scenario;
}

void ScriptedDaemon::refuse(wire::CommandKind kind, const std::string &point, int times, const std::string &text) {
  refusals_[{kind, point}] = {times, text};
}

void ScriptedDaemon::take(const RoomOutput &out, std::int64_t now_ns) {
  constexpr std::int64_t kThinking_ns = 20'000'000;
  for (const auto &command : out.commands) {
    commands.push_back(command);
    wire::CommandReply reply{};
    reply.id = command.id;
    (void)wire::set_name(reply.client, wire::view(command.client));
    reply.result = bregma_wire_COMMAND_DONE;
    wire::set_text(reply.text, "done");
    const bool touch =
        command.kind == bregma_wire_COMMAND_CAPTURE_FIDUCIAL || command.kind == bregma_wire_COMMAND_CHECK_TOUCH;
    const auto found = refusals_.find({command.kind, touch ? wire::text(command.body._u.touch.point) : ""});
    if (found != refusals_.end() && found->second.left-- > 0) {
      reply.result = bregma_wire_COMMAND_REFUSED;
      wire::set_text(reply.text, found->second.text);
    }
    if (!deaf_) {
      replies_.emplace_back(now_ns + kThinking_ns, reply);
    }
  }
  states_.clear();
  if (out.truths.empty()) {
    return;
  }
  const auto &truth = out.truths.back();
  for (std::uint32_t i = 0; i < truth.tool_count; ++i) {
    wire::NavigationState state{};
    (void)wire::set_name(state.tool, wire::view(truth.tools[i].tool));
    state.status = live ? bregma_wire_POSE_LIVE : bregma_wire_POSE_TOOL_HIDDEN;
    state.acquired_time_ns = truth.time_ns;
    state.T_image_tip = live ? truth.tools[i].T_image_tip : wire::unknown_pose();
    for (int axis = 0; axis < 3; ++axis) {
      state.T_image_tip.translation_mm[axis] += bias_mm[axis];
    }
    states_.push_back(state);
  }
}

void ScriptedDaemon::give(SimulatedRoom &room, std::int64_t now_ns) {
  for (const auto &[due_ns, reply] : replies_) {
    if (due_ns <= now_ns) {
      room.on_reply(reply);
    }
  }
  std::erase_if(replies_, [now_ns](const auto &entry) { return entry.first <= now_ns; });
  for (const auto &state : states_) {
    room.on_navigation(state, now_ns);
  }
}

std::string Recording::events_text() const {
  std::string out;
  for (const auto &event : all.events) {
    out += event.step + " " + std::to_string(static_cast<int>(event.kind)) + " " + event.text + "\n";
  }
  return out;
}

Recording play(SimulatedRoom &room, ScriptedDaemon &daemon, double max_seconds, std::int64_t step_ns) {
  Recording out;
  RoomOutput now;
  const auto append = [](auto &to, const auto &from) { to.insert(to.end(), from.begin(), from.end()); };
  std::int64_t time_ns = kStart_ns;
  const auto end_ns = kStart_ns + static_cast<std::int64_t>(max_seconds * 1e9);
  for (; time_ns < end_ns && !room.finished(); time_ns += step_ns) {
    room.advance(time_ns, now);
    daemon.take(now, time_ns);
    daemon.give(room, time_ns);
    append(out.all.frames, now.frames);
    append(out.all.truths, now.truths);
    append(out.all.robot_states, now.robot_states);
    append(out.all.force_samples, now.force_samples);
    append(out.all.range_samples, now.range_samples);
    append(out.all.commands, now.commands);
    append(out.all.events, now.events);
    out.frame_arrivals_ns.insert(out.frame_arrivals_ns.end(), now.frames.size(), time_ns);
  }
  out.seconds = static_cast<double>(time_ns - kStart_ns) * 1e-9;
  return out;
}

Recording play_for(SimulatedRoom &room, double seconds, std::int64_t step_ns) {
  ScriptedDaemon daemon;
  return play(room, daemon, seconds, step_ns);
}

// The room zero-fills its samples, padding included.
bool same_bytes(const void *a, const void *b, std::size_t size) { return std::memcmp(a, b, size) == 0; }

const wire::TrueTool *find(const wire::SimulatedTruth &truth, const std::string &tool) {
  for (std::uint32_t i = 0; i < truth.tool_count; ++i) {
    if (wire::view(truth.tools[i].tool) == tool) {
      return &truth.tools[i];
    }
  }
  return nullptr;
}

const wire::TrackedTool *find(const wire::TrackerFrame &frame, const std::string &tool) {
  for (std::uint32_t i = 0; i < frame.tool_count && i < bregma_wire_MAX_TOOLS; ++i) {
    if (wire::view(frame.tools[i].tool) == tool) {
      return &frame.tools[i];
    }
  }
  return nullptr;
}

Vector3d translation(const wire::Pose &pose) {
  return {pose.translation_mm[0], pose.translation_mm[1], pose.translation_mm[2]};
}

} // namespace bregma::sim::test
