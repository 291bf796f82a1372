// Execution of the commands, except those of the registration.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "idl/commands.hpp"
#include "server/session/session_core.hpp"
#include "server/session/session_text.hpp"

namespace bregma::server {
Outcome Session::Impl::carry_out(const Ticket &ticket, const wire::CommandBody &body) {
  const auto &of = body._u;
  switch (ticket.kind) {
  case bregma_wire_COMMAND_LOAD_CASE:
    return load_case(ticket, of.folder.folder);
  case bregma_wire_COMMAND_START_PIVOT:
    return start_pivot(wire::text(of.tool.tool));
  case bregma_wire_COMMAND_FINISH_PIVOT:
    return finish_pivot(ticket, wire::text(of.tool.tool));
  case bregma_wire_COMMAND_START_REGISTRATION:
    return start_registration();
  case bregma_wire_COMMAND_CAPTURE_FIDUCIAL:
    return touch(ticket, bregma_wire_CAPTURE_FIDUCIAL_TOUCH, of.touch);
  case bregma_wire_COMMAND_CHECK_TOUCH:
    return touch(ticket, bregma_wire_CAPTURE_CHECK, of.touch);
  case bregma_wire_COMMAND_REMOVE_FIDUCIAL:
    return remove_fiducial(wire::text(of.point.point));
  case bregma_wire_COMMAND_START_TRACE:
    return start_trace(wire::text(of.tool.tool));
  case bregma_wire_COMMAND_STOP_TRACE:
    return stop_trace(wire::text(of.tool.tool));
  case bregma_wire_COMMAND_START_SURFACE_SCAN:
    return start_scan(of.scan);
  case bregma_wire_COMMAND_STOP_SURFACE_SCAN:
    return stop_scan(wire::text(of.device.device));
  case bregma_wire_COMMAND_ACCEPT_REGISTRATION:
    return accept_registration(ticket);
  case bregma_wire_COMMAND_CONFIRM_VERIFICATION:
    return confirm_verification();
  case bregma_wire_COMMAND_START_NAVIGATION:
    return start_navigation(wire::text(of.plan.tool), wire::text(of.plan.trajectory));
  case bregma_wire_COMMAND_STOP_NAVIGATION:
    return Answer{.text = "the navigation has stopped"}; // settle() withdraws the plan
  case bregma_wire_COMMAND_ACKNOWLEDGE_ALARM:
    return acknowledge(wire::text(of.alarm.kind), wire::text(of.alarm.subject));
  case bregma_wire_COMMAND_CLOSE_CASE:
    return close_case();
  case bregma_wire_COMMAND_START_SCANNER_REGISTRATION:
  case bregma_wire_COMMAND_CONFIRM_SCANNER_STEP:
  case bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION:
  case bregma_wire_COMMAND_RESET_SCANNER_REGISTRATION:
    ports_.send_to_scanner(pass_on(ticket, body, config_.answer_timeout_ms));
    return std::nullopt;
  case bregma_wire_COMMAND_MOVE_TO_TRAJECTORY:
    return move_guide(ticket, body);
  case bregma_wire_COMMAND_HOLD_ROBOT:
  case bregma_wire_COMMAND_STOP_ROBOT:
  case bregma_wire_COMMAND_RESET_ROBOT:
    ports_.send_to_arm(pass_on(ticket, body, config_.motion_timeout_ms));
    return std::nullopt;
  }
  return refused("not a command"); // the input check has rejected it already
}

wire::Command Session::Impl::pass_on(const Ticket &ticket, const wire::CommandBody &body, double timeout_ms) {
  wire::Command command{};
  (void)wire::set_name(command.client, ticket.client); // it was received as a valid name
  command.id = ticket.id;
  command.sent_time_ns = ticket.sent_time_ns;
  command.kind = ticket.kind;
  command.body = body;
  passed_on_.push_back({ticket, now_ns + std::llround(timeout_ms * kNanosecondsPerMs)});
  return command;
}

Outcome Session::Impl::move_guide(const Ticket &ticket, const wire::CommandBody &body) {
  const std::string device = wire::text(body._u.motion.device);
  const std::string trajectory = wire::text(body._u.motion.trajectory);
  if (const auto refusal = refuse_arm(device)) {
    return *refusal;
  }
  if (case_->trajectory(trajectory) == nullptr) {
    return refused(not_in_case(*case_, "trajectory", trajectory, case_->trajectories));
  }
  ports_.send_to_arm(pass_on(ticket, body, config_.motion_timeout_ms));
  return std::nullopt;
}

void Session::Impl::on_stage_answer(const StageAnswer &result) {
  const auto found = std::find_if(passed_on_.begin(), passed_on_.end(), [&](const PassedOn &pending) {
    return pending.ticket.client == wire::view(result.client) && pending.ticket.id == result.id &&
           pending.ticket.sent_time_ns == result.sent_time_ns && pending.ticket.kind == result.kind;
  });
  if (found == passed_on_.end()) {
    return; // answered by its time-out
  }
  const Ticket ticket = found->ticket;
  passed_on_.erase(found);
  const Answer told{result.result, std::string(result.text, strnlen(result.text, sizeof result.text))};
  if (result.by_device) {
    reply_cache_.answer(ticket, make_reply(ticket, told));
    log_reply(ticket, make_reply(ticket, told));
  } else {
    answer(ticket, told);
  }
}

void Session::Impl::poll_passed_on() {
  const auto late = [this](const PassedOn &pending) { return now_ns >= pending.deadline_ns; };
  for (auto found = std::find_if(passed_on_.begin(), passed_on_.end(), late); found != passed_on_.end();
       found = std::find_if(passed_on_.begin(), passed_on_.end(), late)) {
    const Ticket ticket = found->ticket;
    passed_on_.erase(found);
    const char *deed = wire::find_command(ticket.kind)->deed;
    answer(ticket, refused(std::string("cannot ") + deed + ": the stage that does it has not answered"));
  }
}

tl::expected<const casefile::ToolModel *, Answer> Session::Impl::find_tool(const std::string &name) const {
  const casefile::ToolModel *tool = case_->tool(name);
  if (tool == nullptr) {
    return tl::unexpected(refused(not_in_case(*case_, "tool", name, case_->tools)));
  }
  if (tool->role == casefile::ToolRole::kReference) {
    return tl::unexpected(refused(name + " is the reference: it has no tip"));
  }
  return tool;
}

tl::expected<const casefile::ToolModel *, Answer> Session::Impl::find_tool_with_tip(const std::string &name) const {
  auto tool = find_tool(name);
  if (tool && !data_.tips.contains(name)) {
    return tl::unexpected(refused(name + " has no tip: calibrate it by a pivot first"));
  }
  if (tool && pivot_ && pivot_->tool() == name) {
    return tl::unexpected(refused("a pivot calibration of " + name + " is running: finish it first"));
  }
  return tool;
}

Outcome Session::Impl::load_case(const Ticket &ticket, const std::string &folder) {
  std::error_code code;
  const auto absolute = std::filesystem::absolute(folder, code);
  if (folder.empty() || code) {
    return refused("\"" + folder + "\" is no case folder");
  }
  if (restoring_ && !restoring_->failed) {
    return refused(restoring_->data.case_folder + " is being loaded: wait for the answer");
  }
  if (load_) {
    return refused(load_->folder + " is being loaded: wait for the answer");
  }
  end_restoring();
  start_loading(absolute.string(), ticket);
  return std::nullopt;
}

Answer Session::Impl::take_case(const LoadedFolder &folder) {
  ports_.use_case(folder.loaded, folder.prepared);
  alarm_registry_.case_closed(now_ns); // the alarms of an earlier case
  case_ = folder.loaded;
  data_.tips.clear();
  data_.case_folder = case_->folder.string();
  data_.case_id = case_->id;
  data_.case_checksum = folder.checksum;
  clear_samples();
  take_tips_of_arm();
  return {.text = "case " + case_->id + ": " + std::to_string(case_->fiducials.size()) + " fiducials, " +
                  std::to_string(case_->landmarks.size()) + " check landmarks, " +
                  std::to_string(case_->targets.size()) + " targets, " + std::to_string(case_->trajectories.size()) +
                  " trajectories, tools " + names_of(case_->tools)};
}

void Session::Impl::send_tip(const std::string &tool, const CalibratedTip &tip) {
  ToolTip message{{}, tip.tip_mm, tip.covariance_mm2};
  (void)wire::set_name(message.tool, tool);
  ports_.send(NavigationMessage(message));
}

// The tools of an arm are calibrated in its flange; a pivot replaces that.
void Session::Impl::take_tips_of_arm() {
  if (!case_->robot) {
    return;
  }
  for (const casefile::RobotToolModel &tool : case_->robot->equipment.tools) {
    CalibratedTip tip{};
    Eigen::Map<geometry::Vector3d>(tip.tip_mm.data()) = tool.tip_mm;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(tip.covariance_mm2.data()) =
        tool.sigma_mm * tool.sigma_mm * geometry::Matrix3d::Identity();
    tip.rms_mm = tool.sigma_mm;
    tip.time_ns = now_ns;
    data_.tips[tool.name] = tip;
    send_tip(tool.name, tip);
  }
}

Answer Session::Impl::start_pivot(const std::string &tool) {
  if (const auto found = find_tool(tool); !found) {
    return found.error();
  }
  if (pivot_ && (pivot_->finishing() || pivot_->tool() != tool)) {
    return refused("a pivot calibration of " + pivot_->tool() + " is running: finish it first");
  }
  const auto made_by = [&tool](const auto &sample) { return wire::view(sample.tool) == tool; };
  const bool has_samples = std::any_of(data_.surface.begin(), data_.surface.end(), made_by) ||
                           std::any_of(data_.fiducials.begin(), data_.fiducials.end(),
                                       [&](const auto &item) { return made_by(item.second); });
  if (machine_.stage() == bregma_wire_SESSION_REGISTERING && (has_samples || capture_ || tracing_ == tool)) {
    return refused("samples of this registration were made with the present tip of " + tool +
                   ": start the registration anew, then calibrate");
  }
  pivot_.emplace(next_request_++, tool, config_.pivot_max_samples);
  PivotRequest request{pivot_->id(), {}, true};
  (void)wire::set_name(request.tool, tool);
  ports_.send(NavigationMessage(request));
  return {.text = "rest the tip of " + tool + " in a dimple and turn the tool about it"};
}

Outcome Session::Impl::finish_pivot(const Ticket &ticket, const std::string &tool) {
  if (!pivot_ || pivot_->finishing() || pivot_->tool() != tool) {
    return refused("no pivot calibration of \"" + tool + "\" is running" +
                   (pivot_ ? "; one of " + pivot_->tool() + " is" : ""));
  }
  PivotRequest request{pivot_->id(), {}, false};
  (void)wire::set_name(request.tool, tool);
  ports_.send(NavigationMessage(request));
  calibration::PivotOptions options;
  options.min_rotation_rad = config_.pivot_min_rotation_rad;
  options.tracker_noise_mm = config_.tracker_sigma_mm;
  pivot_->finish(options, executor_);
  if (const auto *result = pivot_->result()) {
    return take_pivot(*result);
  }
  pivot_ticket_ = ticket;
  return std::nullopt;
}

Answer Session::Impl::take_pivot(const calibration::PivotResult &result) {
  const calibration::PivotResult pivot = result; // a copy, because the run that owns it ends here
  const std::string tool = pivot_->tool();
  pivot_.reset();
  pivot_ticket_.reset();
  if (!pivot.accepted()) {
    constexpr std::string_view kVerdict = "refused: "; // not repeated in the answer
    return refused(tool + " is not calibrated: " +
                   (pivot.text.starts_with(kVerdict) ? pivot.text.substr(kVerdict.size()) : pivot.text));
  }
  CalibratedTip tip;
  Eigen::Map<geometry::Vector3d>(tip.tip_mm.data()) = pivot.tip_mm;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(tip.covariance_mm2.data()) = pivot.covariance_mm2;
  tip.rms_mm = pivot.rms_mm;
  tip.time_ns = now_ns;
  data_.tips[tool] = tip;
  changed();
  send_tip(tool, tip);

  std::string text = tool + ": " + pivot.text;
  // Checks made with the old tip are not valid for the new one.
  const auto voided =
      std::erase_if(data_.checks, [&](const auto &item) { return wire::view(item.second.tool) == tool; });
  if (voided > 0 && data_.checks.size() < config_.min_checks && machine_.demote()) {
    text += "; the checks were made with the old tip: verify again";
  }
  return {.text = text, .value_mm = pivot.rms_mm};
}

void Session::Impl::on_pivot_pose(const PivotPose &pose) {
  if (pivot_) {
    pivot_->add(pose);
  }
}

Answer Session::Impl::start_navigation(const std::string &tool, const std::string &trajectory) {
  if (const auto found = find_tool_with_tip(tool); !found) {
    return found.error();
  }
  if (!trajectory.empty() && case_->trajectory(trajectory) == nullptr) {
    return refused(not_in_case(*case_, "trajectory", trajectory, case_->trajectories));
  }
  plan_ = PlanSelected{{}, {}, true};
  (void)wire::set_name(plan_->tool, tool);
  (void)wire::set_name(plan_->trajectory, trajectory);
  ports_.send(NavigationMessage(*plan_));
  return {.text = tool + (trajectory.empty() ? " without a plan" : " along " + trajectory)};
}

Answer Session::Impl::acknowledge(const std::string &kind, const std::string &subject) {
  if (const auto refusal = alarm_registry_.acknowledge(kind, subject, now_ns)) {
    return refused(*refusal);
  }
  if (kind == alarm::kDrift) {
    ports_.send(MonitoringMessage(DriftRestart{now_ns}));
  }
  return {.text = kind + (subject.empty() ? "" : " of " + subject) + " is acknowledged"};
}

Answer Session::Impl::close_case() {
  abandon("the case was closed");
  clear_samples();
  const std::string id = case_ ? case_->id : "";
  data_.tips.clear();
  data_.case_folder.clear();
  data_.case_id.clear();
  case_.reset();
  ports_.use_case(nullptr, nullptr);
  alarm_registry_.case_closed(now_ns);
  return {.text = id.empty() ? "no case was loaded" : "case " + id + " is closed"};
}

void Session::Impl::abandon(const std::string &reason) {
  if (!tracing_.empty()) {
    end_trace();
  }
  std::vector<Ticket> waiting;
  if (capture_) {
    waiting.push_back(capture_->ticket);
  }
  if (accept_) {
    waiting.push_back(accept_->ticket);
  }
  if (pivot_) {
    PivotRequest request{pivot_->id(), {}, false};
    (void)wire::set_name(request.tool, pivot_->tool());
    ports_.send(NavigationMessage(request));
  }
  if (pivot_ticket_) {
    waiting.push_back(*pivot_ticket_);
  }
  capture_.reset();
  accept_.reset();
  pivot_.reset();
  pivot_ticket_.reset();
  for (const Ticket &ticket : waiting) {
    answer(ticket, refused("given up: " + reason));
  }
}

} // namespace bregma::server
