// What an arm may do at a time: the decisions of its driver, without socket, DDS and clock.
//
// A motion is one command (COMMAND_START_SURFACE_SCAN, COMMAND_MOVE_TO_TRAJECTORY) with a wire::RobotPath of the same
// client and id. It begins when the arm has accepted the path and the client's RobotDeadman arrives, and it goes on
// only while all of these hold:
//
// - the deadman of this client and motion arrives, with increasing numbers, at most 150 ms apart;
// - the arm is connected, enabled, and states that it is simulated;
// - the daemon is heard, and is the same as at the start;
// - for a motion that depends on the registration (always MOVE_TO_TRAJECTORY): the session is verified or navigating,
//   and the accepted registration is the one that the path was made with;
// - for a path that needs it (beside a tracker): the daemon's RobotPermit for this motion arrives, with increasing
//   numbers, at most 150 ms apart, and has not been withdrawn.
//
// Otherwise the arm stops, and the stop is latched with its cause until COMMAND_RESET_ROBOT. Stop and hold are taken
// from every client, at every time.
//
// Times: steady UTC in ns, as Io::now_ns. Not for several threads at a time.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/arm/arm_line.hpp"
#include "idl/topics.hpp"

namespace bregma::arm {

struct MotionOptions {
  std::int64_t deadman_ns = kAlive_ns;
  std::int64_t permit_ns = kAlive_ns;
  std::int64_t daemon_silence_ns = 1'500'000'000; // SystemHealth arrives twice per second
  std::int64_t path_wait_ns = 1'000'000'000;      // between a command and its path
  std::int64_t start_wait_ns = 2'000'000'000;     // until arm and deadman are there
  double max_speed_mm_s = 100.0;
};

// The motion that was commanded last.
struct CommandedMotion {
  wire::Command command{};
  wire::RobotPath path{};
  bool has_path = false;
  std::uint32_t number = 0;      // the arm's
  std::uint32_t last_answer = 0; // number of the message of the last waypoint
  bool accepted = false;         // by the arm
  bool needs_registration = false;
  std::uint64_t run_id = 0;   // of the daemon at the start
  std::uint64_t revision = 0; // accepted registration at the start
  std::int64_t began_ns = 0;
  std::int64_t deadman_ns = 0; // 0: none yet
  std::uint64_t deadman_frame = 0;
  std::int64_t permit_ns = 0; // 0: none yet
  std::uint64_t permit_frame = 0;
};

class MotionControl {
public:
  MotionControl(std::string device, const MotionOptions &options);

  // The arm's side.
  void connected(const Identity &identity);
  void disconnected();
  // The driver ends: a motion stops.
  void end();
  void take(const OperatingState &state);
  void take(const SetpointJs &setpoint);
  void take(const Answer &answer);

  // The wire's side. Samples for other devices are ignored.
  void take(const wire::Command &command, std::int64_t now_ns);
  void take(const wire::RobotPath &path, std::int64_t now_ns);
  void take(const wire::RobotPermit &permit, std::int64_t now_ns);
  void take(const wire::RobotDeadman &deadman, std::int64_t now_ns);
  void take(const wire::SystemHealth &health, std::int64_t now_ns);
  void take(const wire::RegistrationState &registration, std::int64_t now_ns);

  // Checks all conditions; at least every 20 ms.
  void step(std::int64_t now_ns);

  // Lines for the arm, and replies, since the last call.
  [[nodiscard]] std::string take_lines();
  [[nodiscard]] std::vector<wire::CommandReply> take_replies();
  // The fields that are the control's own; frame and times are the caller's.
  [[nodiscard]] wire::RobotMotionState state(std::int64_t now_ns) const;

  [[nodiscard]] wire::RobotMotionPhase phase() const { return phase_; }
  [[nodiscard]] wire::RobotStopCause cause() const { return cause_; }
  [[nodiscard]] wire::RobotMode mode() const;
  // Client of the motion under way; empty: none.
  [[nodiscard]] std::string_view motion_client() const;
  [[nodiscard]] std::uint64_t motion_id() const;
  // Samples that were refused at the border, since the start.
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

private:
  void begin(const wire::Command &command, std::int64_t now_ns);
  // Starts the motion whose command and path are there.
  void send_path();
  void stop(wire::RobotStopCause cause, std::string_view text);
  // Why a motion has not begun in time.
  [[nodiscard]] std::string_view reason_to_give_up() const;
  // Ends a motion that the arm has not begun.
  void drop(std::string_view text);
  void hold(const wire::Command &command, std::string_view text);
  void reset(const wire::Command &command);
  // Why a motion must not begin; empty: it may.
  [[nodiscard]] std::string refusal(const wire::Command &command, std::int64_t now_ns) const;
  [[nodiscard]] std::string path_problem(const wire::RobotPath &path) const;
  // The first condition that does not hold any more; STOP_NONE: all hold.
  [[nodiscard]] wire::RobotStopCause violated(std::int64_t now_ns) const;
  [[nodiscard]] bool verified() const;
  [[nodiscard]] bool daemon_heard(std::int64_t now_ns) const;
  [[nodiscard]] bool active() const;                       // waits or under way
  [[nodiscard]] bool permitted(std::int64_t now_ns) const; // by the daemon, or needs no permit
  std::uint32_t send(Order::Kind kind);
  void reply(const wire::Command &command, wire::CommandResult result, std::string_view text);

  std::string device_;
  MotionOptions options_;

  std::optional<Identity> arm_;
  std::optional<OperatingState> arm_state_;
  std::optional<SetpointJs> setpoint_;
  std::uint32_t next_number_ = 1; // of messages
  std::uint32_t next_motion_ = 1;
  std::string lines_;
  std::vector<wire::CommandReply> replies_;

  wire::RobotMotionPhase phase_ = bregma_wire_MOTION_NONE;
  wire::RobotStopCause cause_ = bregma_wire_STOP_NONE;
  std::string text_;
  std::optional<CommandedMotion> motion_;
  std::optional<wire::RobotPath> waiting_path_;
  std::int64_t path_ns_ = 0;
  std::optional<wire::Command> resetting_;
  std::uint32_t reset_number_ = 0;

  std::uint64_t run_id_ = 0; // of the daemon heard last; 0: none
  wire::SessionState session_ = bregma_wire_SESSION_UNKNOWN;
  std::int64_t health_ns_ = 0;
  std::uint64_t accepted_revision_ = 0;
  std::uint64_t refused_ = 0;
};

} // namespace bregma::arm
