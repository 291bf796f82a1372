// Fixtures of the component tests: a case in a temporary folder, a session that reached Registered in virtual time, and
// the real daemon and simulated room as processes on a separate DDS domain.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "idl/dds.hpp"
#include "tests/support/process.hpp"
#include "tests/support/virtual_operation.hpp"

namespace bregma::test {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true; // several times slower: waiting times are not tested
#else
inline constexpr bool kSanitized = false;
#endif

inline constexpr std::uint64_t kSeed = 11; // seed of every operation unless a test states another

// An ellipsoidal head with a brain and one critical structure, saved and loaded again.
class CaseFolder {
public:
  // change: of the case before it is saved.
  explicit CaseFolder(const std::function<void(casefile::Case &)> &change = {});
  [[nodiscard]] const casefile::Case &loaded() const { return case_; }
  void reload(); // after a program has changed it

private:
  TemporaryFolder folder_;
  casefile::Case case_;
};

// The steps up to an accepted registration, and those from there to navigation, as scenario text.
extern const std::string kCalibrateSteps;
extern const std::string kRegisterSteps; // contain those to calibrate
extern const std::string kNavigateSteps;

[[nodiscard]] sim::Scenario scenario_of(const std::string &toml);

// Runs kRegisterSteps in virtual time and writes the snapshot to state_folder. A daemon started there restores the
// session as Registered, for the patient of this seed.
void register_in_virtual_time(const CaseFolder &folder, const std::string &state_folder, std::uint64_t seed = kSeed);

// The DDS domain of this process's operations.
[[nodiscard]] std::uint32_t operation_domain();

// bregmad and bregma-sim-room, and an observer of their samples.
class Operation {
public:
  // change: of the case before it is saved.
  explicit Operation(const std::function<void(casefile::Case &)> &change = {});

  // before: words of the command before the program, such as "/usr/bin/env" with variables.
  void start_daemon(const std::vector<std::string> &settings = {}, const std::vector<std::string> &before = {});
  // steps: scenario text; the room's log is kept.
  void start_room(const std::string &scenario_toml, const std::vector<std::string> &options = {});

  // From a registration made in virtual time: daemon and room, in which the probe follows the trajectory for minutes.
  // False if no unverified pose comes.
  [[nodiscard]] bool start_unverified();
  // Reads received samples until done() is true; false after the timeout, which only limits a hang.
  [[nodiscard]] bool observe_until(const std::function<bool()> &done, double seconds = 60.0);
  // Reads samples for this time.
  void observe_for(double seconds);

  [[nodiscard]] const CaseFolder &case_folder() const { return case_; }
  [[nodiscard]] CaseFolder &case_folder() { return case_; }
  [[nodiscard]] const std::filesystem::path &state_folder() const { return state_.path(); }
  [[nodiscard]] Process &daemon() { return *daemon_; }
  [[nodiscard]] Process &room() { return *room_; }
  [[nodiscard]] std::uint32_t domain() const { return domain_; }
  [[nodiscard]] std::string logs() const; // logs of both, for messages

  // The latest sample of each type, and all states of the tool Probe since the last clear.
  wire::SystemHealth health{};
  wire::RegistrationState registration{};
  wire::AccuracyState accuracy{};
  std::vector<wire::NavigationState> probe;
  std::vector<wire::Alarm> alarms;
  std::vector<wire::CommandReply> replies; // replies to the operator
  [[nodiscard]] bool alarm_raised(std::string_view kind) const;
  [[nodiscard]] const wire::DeviceHealth *device(std::string_view name) const;
  [[nodiscard]] bool probe_is(wire::PoseStatus status) const;

private:
  void take_all();

  std::uint32_t domain_;
  CaseFolder case_;
  TemporaryFolder state_;
  TemporaryFolder logs_;
  dds::Participant participant_;
  dds::Reader<wire::NavigationState> navigation_;
  dds::Reader<wire::SystemHealth> health_;
  dds::Reader<wire::RegistrationState> registration_;
  dds::Reader<wire::AccuracyState> accuracy_;
  dds::Reader<wire::Alarm> alarms_;
  dds::Reader<wire::CommandReply> replies_;
  std::unique_ptr<Process> daemon_;
  std::unique_ptr<Process> room_;
  int rooms_ = 0;
};

} // namespace bregma::test
