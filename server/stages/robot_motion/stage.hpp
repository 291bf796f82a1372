// Stage robot motion: commands about the motion of an arm. It plans and checks the move of the guide onto a trajectory
// (guide_plan.hpp), sends the path, and passes the command on to the arm's driver in the name of the client, who holds
// the deadman. Hold, stop and reset do not pass through it: the session's stage has sent them to the driver already.
//
// The driver answers a command that was passed on; its reply is the command's only one. The stage watches for it, and
// answers itself when it does not come. It moves nothing: the conditions of a motion are the driver's
// (drivers/arm/motion_control.hpp). One of them, beside a tracker, is this stage's permit: it watches the patient, the
// hand-eye calibration and the guide (guide_watch.hpp) until the motion has ended. It then judges the shown guide
// against the plan.
//
// A worker that may be busy for a second with a path. It must run (no rate of 0), because the session waits for it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/parameters.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/host.hpp"
#include "server/stages/monitoring/alarm_conditions.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/robot_motion/guide_watch.hpp"
#include "server/stages/robot_motion/patient_place.hpp"
#include "server/stages/robot_tool/tool_pose.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct RobotMotionParameters {
  double rate_hz = 50.0;
  double min_distance_mm = 10.0;
  double max_patient_mm = 2.0;
  double max_off_mm = 2.0;
  ToolPoseOptions arm; // for an arm that states no covariance; set by the wiring from the parameters of robot tool
};
void declare(base::ParameterSet &set, RobotMotionParameters &parameters);

class RobotMotionStage final : public Stage {
public:
  static constexpr const char *kName = "robot motion";
  using Parameters = RobotMotionParameters;

  RobotMotionStage(const RobotMotionParameters &parameters, const StageContext &context);
  void connect(RobotMotionInbox &commands, CaseStore &cases, const runtime::LatestValue<RobotsView> &robots,
               const runtime::LatestValue<TrackingView> &tracking,
               const runtime::LatestValue<RegistrationEstimate> &registration,
               const runtime::LatestValue<ReferenceView> &reference);

  void step(const Moment &now) noexcept override;

  StageAnswers answers;
  AlarmEvents conditions;

private:
  struct Waiting { // for the driver's reply
    wire::Command command{};
    std::int64_t deadline_ns = 0; // set by the next step: this one may have planned for seconds
  };

  // The motion that was planned last, until its end was judged.
  struct Watched {
    wire::Command command{};
    WatchedGuide guide;
    bool permit = false; // its path needs one
    std::string problem; // the permit was withdrawn
    std::uint64_t frame = 0;
    std::int64_t began_ns = 0; // set by the next step, as above
    std::int64_t done_ns = 0;  // the arm is at the end; 0: it is not
  };

  void refresh() noexcept;
  void watch(const Moment &now);
  void send_permit(std::int64_t now_ns);
  void judge_end(std::int64_t now_ns);
  void move(const wire::Command &command, const Moment &now);
  void take_replies(std::int64_t now_ns);
  void give_up(std::int64_t now_ns);
  void answer(const wire::Command &command, wire::CommandResult result, const std::string &text,
              bool by_device = false);
  [[nodiscard]] const RobotView *robot_named(const wire::Name &device) const;

  RobotMotionParameters parameters_;
  Host &host_;
  Subscriber<wire::CommandReply> replies_;
  Publisher<wire::Command> commands_;
  Publisher<wire::RobotPath> paths_;
  Publisher<wire::RobotPermit> permits_;
  AlarmConditions alarms_;
  RobotMotionInbox *inbox_ = nullptr;
  CaseLease lease_;
  const casefile::Case *case_ = nullptr;
  runtime::LatestInput<RobotsView> robots_;
  runtime::LatestInput<TrackingView> tracking_;
  runtime::LatestInput<RegistrationEstimate> registration_;
  runtime::LatestInput<ReferenceView> reference_;
  PatientPlace patient_;
  std::int64_t reference_ns_ = 0; // exposure of the newest one in patient_
  std::optional<Watched> watched_;
  std::vector<wire::Command> arrived_; // of this step; its capacity stays
  std::vector<Waiting> waiting_;
};

} // namespace bregma::server
