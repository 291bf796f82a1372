// A small case on disk, and fake loops that answer at once, for tests of the session.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "algorithms/geometry/rigid3.hpp"
#include "server/session/session.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::server::testing {

constexpr wire::SessionState kDegraded = bregma_wire_SESSION_DEGRADED;
constexpr wire::SessionState kIdle = bregma_wire_SESSION_IDLE;
constexpr wire::SessionState kCaseLoaded = bregma_wire_SESSION_CASE_LOADED;
constexpr wire::SessionState kRegistering = bregma_wire_SESSION_REGISTERING;
constexpr wire::SessionState kRegistered = bregma_wire_SESSION_REGISTERED;
constexpr wire::SessionState kVerified = bregma_wire_SESSION_VERIFIED;
constexpr wire::SessionState kNavigating = bregma_wire_SESSION_NAVIGATING;
constexpr wire::SessionState kFault = bregma_wire_SESSION_FAULT;

using bregma::test::TemporaryFolder;

// A ball of 80 mm with six fiducials F1..F6, five landmarks L1..L5, target "Deep", trajectory "Plan", and the tools
// Reference, Stylus and Probe. Returns the folder.
std::filesystem::path write_case(const std::filesystem::path &parent, const std::string &id = "ball");

// The loops as seen by the session. All sent or published messages are kept. A capture returns the true position of the
// point plus `miss_mm` in Image. The registration is the true one with a stated covariance.
class FakeLoops : public SessionPorts {
public:
  FakeLoops();
  PrepareCase preparation() override;
  void use_case(std::shared_ptr<const casefile::Case> loaded, std::shared_ptr<PreparedCase> prepared) override;
  void send(const NavigationMessage &message) override { navigation.push_back(message); }
  void send(const RegistrationMessage &message) override;
  void send(const MonitoringMessage &message) override { monitoring.push_back(message); }
  void send_to_scanner(const wire::Command &command) override { to_scanner.push_back(command); }
  void send_to_arm(const wire::Command &command) override { to_arm.push_back(command); }
  void send(const ScanRequest &request) override { to_scan.push_back(request); }
  void publish(const wire::CommandReply &reply) override { replies.push_back(reply); }
  void publish(const wire::Alarm &alarm) override { alarms.push_back(alarm); }
  void publish(const wire::CapturedPoint &point) override { captured.push_back(point); }
  void log(const std::string &line) override { lines.push_back(line); }

  // The last message of a kind; fails the test and throws if there is none.
  template <class Message, class List> [[nodiscard]] static Message last(const List &list) {
    for (auto it = list.rbegin(); it != list.rend(); ++it) {
      if (const auto *found = std::get_if<Message>(&*it)) {
        return *found;
      }
    }
    throw std::logic_error("no such message was sent");
  }
  template <class Message, class List> [[nodiscard]] static std::size_t count(const List &list) {
    std::size_t out = 0;
    for (const auto &item : list) {
      out += std::holds_alternative<Message>(item) ? 1U : 0U;
    }
    return out;
  }

  [[nodiscard]] CaptureResult answer(const CaptureRequest &request) const;
  [[nodiscard]] RegistrationEstimate estimate() const;
  // The position of a tip in Reference from a point in Image.
  [[nodiscard]] Array3 in_reference(const Eigen::Vector3d &image_mm) const;
  // Poses of a tool that rotates about its resting tip; sigma: standard deviation of the position.
  [[nodiscard]] std::vector<PivotPose> pivot(std::uint64_t id, double sigma_mm, double angle_rad, unsigned seed) const;

  std::shared_ptr<const casefile::Case> the_case;
  std::vector<NavigationMessage> navigation;
  std::vector<RegistrationMessage> registration;
  std::vector<MonitoringMessage> monitoring;
  std::vector<wire::Command> to_scanner, to_arm;
  std::vector<ScanRequest> to_scan;
  std::vector<wire::CommandReply> replies;
  std::vector<wire::Alarm> alarms;
  std::vector<wire::CapturedPoint> captured;
  std::vector<std::string> lines;

  geometry::Rigid3<geometry::frame::Image, geometry::frame::Reference> truth;
  Eigen::Vector3d miss_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d tip_mm{-180.0, 4.0, 7.0}; // tip of every tool
  double registration_sigma_mm = 0.2;       // standard deviation of the translation
  CaptureStatus capture_status = CaptureStatus::kOk;
  wire::RegistrationStatus registration_status = bregma_wire_REGISTRATION_CANDIDATE;
  std::string registration_text = "a candidate";
  std::uint64_t revision = 0; // revision of the last sample message
};

// A session with its loops, a client, and time controlled by the test.
class SessionHarness {
public:
  explicit SessionHarness(const std::filesystem::path &folder, FakeLoops &fakes, Executor executor = {});

  // Sends a command, runs the loops and returns the reply; empty while the command is running.
  std::optional<wire::CommandReply> send(const wire::Command &command);
  [[nodiscard]] wire::Command command(wire::CommandKind kind, const std::string &first = "",
                                      const std::string &second = "");
  // The reply to a new command of this kind; fails the test if there is none.
  wire::CommandReply ask(wire::CommandKind kind, const std::string &first = "", const std::string &second = "");
  // Runs the loops' pending answers and advances the time.
  void run(double milliseconds);
  // ask() and expect COMMAND_DONE; shows the reply's text on failure.
  wire::CommandReply done(wire::CommandKind kind, const std::string &first = "", const std::string &second = "");
  void condition(const char *kind, const char *subject, bool active, SessionEffect effect, const char *text = "text");
  void trace(const std::string &tool, int samples);

  // Runs a biopsy up to a stage.
  void up_to(wire::SessionState stage, const std::filesystem::path &case_folder);
  void pivot(const std::string &tool);
  void check_landmarks();

  FakeLoops &loops;
  SessionConfig config;
  std::unique_ptr<Session> session;
  std::int64_t now_ns = 1'700'000'000'000'000'000;
  bool answering = true; // false: the loops are silent

private:
  std::uint64_t next_id_ = 1;
  std::size_t answered_ = 0; // number of processed navigation messages
};

} // namespace bregma::server::testing
