// Stage session: reads commands and publishes replies. The session decides (server/session/session.hpp), and the other
// stages receive messages in their inboxes. A worker, because it allocates and logs. It does not wait for the disk.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "base/parameters.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/session/command_gate.hpp"
#include "server/session/session.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/host.hpp"
#include "server/stages/monitoring/stage.hpp"
#include "server/stages/navigation/stage.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/registration/stage.hpp"
#include "server/stages/scanner/stage.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/surface_scan/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct SessionParameters {
  double capture_window_ms = SessionConfig{}.capture_window_ms;
  double capture_max_motion_mm = SessionConfig{}.capture_max_motion_mm;
  double trace_spacing_mm = SessionConfig{}.trace_spacing_mm;
  std::int64_t trace_max_samples = kMaxSurfaceSamples;
  double pivot_min_rotation_deg = 20.0;
  std::int64_t pivot_max_samples = static_cast<std::int64_t>(SessionConfig{}.pivot_max_samples);
  std::int64_t min_checks = static_cast<std::int64_t>(SessionConfig{}.min_checks);
  std::string state_directory; // empty: $STATE_DIRECTORY (systemd), $XDG_STATE_HOME/bregma or ~/.local/state/bregma
  double check_valid_min = SessionConfig{}.check_valid_min;
  double correlation_length_mm = 12.0; // correlation of the surface error between neighbouring samples
};
void declare(base::ParameterSet &set, SessionParameters &parameters);

class SessionStage final : public Stage, private SessionPorts {
public:
  static constexpr const char *kName = "session";
  using Parameters = SessionParameters;

  SessionStage(const SessionParameters &parameters, const StageContext &context);
  void connect(NavigationEvents &events, AlarmEvents &conditions,
               const runtime::LatestValue<RegistrationEstimate> &estimate, StageAnswers &scanner_answers,
               AlarmEvents &scanner_conditions, NavigationEvents &scan_events, AlarmEvents &scan_conditions,
               StageAnswers &motion_answers, AlarmEvents &motion_conditions);

  // Restores the last session, so that what the other stages take from their first step on belongs to it.
  void begin(const Moment &now) override;
  void step(const Moment &now) noexcept override;

  [[nodiscard]] const Session &session() const { return session_; }

  CaseStore cases;
  NavigationStage::Inbox to_navigation;
  RegistrationStage::Inbox to_registration;
  MonitoringStage::Inbox to_monitoring;
  ScannerInbox to_scanner;
  RobotMotionInbox to_arm;
  SurfaceScanStage::Inbox to_scan;
  runtime::LatestValue<SessionView> view;

private:
  [[nodiscard]] PrepareCase preparation() override;
  void use_case(std::shared_ptr<const casefile::Case> loaded, std::shared_ptr<PreparedCase> prepared) override;
  void send(const NavigationMessage &message) override { to_navigation.send(message); }
  void send(const RegistrationMessage &message) override { to_registration.send(message); }
  void send(const MonitoringMessage &message) override { to_monitoring.send(message); }
  void send_to_scanner(const wire::Command &command) override { to_scanner.send(command); }
  void send_to_arm(const wire::Command &command) override;
  void send(const ScanRequest &request) override { to_scan.send(request); }
  void publish(const wire::CommandReply &reply) override;
  void publish(const wire::Alarm &alarm) override;
  void publish(const wire::CapturedPoint &point) override { captures_(point, now_ns_); }
  void log(const std::string &line) override { host_.log(LogLevel::kInfo, line); }

  using Recording = JobResult<base::Result<std::optional<std::filesystem::path>>>;

  // False if the command is not carried out.
  [[nodiscard]] bool take(const wire::Command &command, std::uint64_t writer);
  void watch_commands();
  void take_in();
  void tell_of_recording();
  void share_view();

  SessionParameters parameters_;
  Host &host_;
  Subscriber<wire::Command> commands_;
  Publisher<wire::CommandReply> replies_;
  Publisher<wire::Command> to_driver_; // of the arm
  Publisher<wire::Alarm> alarms_;
  Publisher<wire::CapturedPoint> captures_;
  NavigationEvents *events_ = nullptr;
  NavigationEvents *scan_events_ = nullptr;
  AlarmEvents *scan_conditions_ = nullptr;
  AlarmEvents *motion_conditions_ = nullptr;
  AlarmEvents *conditions_ = nullptr;
  StageAnswers *scanner_answers_ = nullptr;
  StageAnswers *motion_answers_ = nullptr;
  AlarmEvents *scanner_conditions_ = nullptr;
  runtime::LatestInput<RegistrationEstimate> estimate_;
  std::int64_t now_ns_ = 0;                           // UTC, of the step under way
  std::deque<std::shared_ptr<Recording>> recordings_; // begun, with an outcome that the session does not know yet
  CommandGate gate_;
  std::uint64_t excess_seen_ = 0;
  std::int64_t excess_ns_ = 0; // when commands were refused last
  std::string excess_client_;  // one of them
  Session session_;            // last, because it calls the ports
};

} // namespace bregma::server
