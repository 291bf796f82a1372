// A client's connection to a daemon: its broadcasts, and commands with their replies.
//
// Threads: one object, one thread. Errors: the constructor throws dds::Error (the domain cannot be joined); all
// other errors are returned as sentences for the user.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "base/result.hpp"
#include "clients/live/daemons.hpp"
#include "idl/commands.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "idl/peers.hpp"

namespace bregma::live {

class DaemonLink {
public:
  using Duration = std::chrono::nanoseconds;

  // A client that only reads creates no writer. A display also reads what only pictures need: trackers and captures.
  enum class Role { kReads, kDisplay, kCommands };
  // wait_s: default of wait_for_daemon(), and for send().
  DaemonLink(std::uint32_t domain, Role role, double wait_s = 3.0);

  // Waits until a daemon is present and, for commands, connected in both directions. The error for a daemon of another
  // release names both wire versions.
  [[nodiscard]] base::Result<void> wait_for_daemon() { return wait_for_daemon(presence_wait_); }
  [[nodiscard]] base::Result<void> wait_for_daemon(Duration timeout);

  // Waits for the daemon if necessary, sends, and waits for the reply to this command. A refusal is a reply (see result
  // and text), not an error. A command with a receiver is answered by that device; a motion of an arm by the daemon or
  // the arm. Precondition: the role is kCommands.
  // sent: called with the command's id when it has been written, for what belongs to it on another topic.
  [[nodiscard]] base::Result<wire::CommandReply> send(wire::Command command, Duration timeout = std::chrono::seconds(5),
                                                      const std::function<void(std::uint64_t)> &sent = {});

  // Reads received samples; waits up to timeout if there are none. True if there were new ones. The time of a sample's
  // arrival is that of this call: a program that shows poses calls it at least every few milliseconds.
  bool update(Duration timeout);

  // Waits until the state is complete after joining: every topic with a writer has delivered a sample, or the time has
  // elapsed.
  void settle(Duration timeout = std::chrono::milliseconds(600));

  // Whether the deformation field is read; at first it is not, because the daemon computes it for its readers. Only for
  // the role kDisplay.
  void want_field(bool wanted);
  // The same for the scanner's corrected slices, which are large.
  void want_slices(bool wanted);

  // Of the daemon that is followed: the first that was heard, until it is lost.
  [[nodiscard]] const Snapshot &snapshot() { return daemons_.followed(); }

  // For further topics of the same program.
  [[nodiscard]] const dds::Participant &participant() const { return participant_; }
  [[nodiscard]] std::uint32_t domain() const { return domain_; }
  [[nodiscard]] const std::string &client() const { return client_; } // unique to this object

private:
  struct Control {
    explicit Control(const dds::Participant &participant) : commands(participant), replies(participant) {}
    dds::Writer<wire::Command> commands;
    dds::Reader<wire::CommandReply> replies;
  };

  struct Pictures {
    explicit Pictures(const dds::Participant &participant);
    dds::Reader<wire::TrackerFrame> trackers;
    dds::Reader<wire::CapturedPoint> captures;
    dds::Reader<wire::ScannerRegistration> scanners;
    dds::Reader<wire::RobotTool> robot_tools;
    std::optional<dds::Reader<wire::DeformationField>> field;
    std::optional<dds::Reader<wire::CorrectedSlice>> slices;
  };

  [[nodiscard]] base::Error no_daemon();
  [[nodiscard]] bool speaks_our_wire();
  [[nodiscard]] bool is_connected() const;
  [[nodiscard]] bool connects(const dds::Guid &participant) const; // in both directions
  [[nodiscard]] bool wait_for_device(const std::string &device);
  [[nodiscard]] bool transits_known();
  bool take_all();
  template <class T> Daemons::Speaker *speaker_of(const dds::Reader<T> &reader, std::uint64_t writer);
  template <class T, class Store> std::size_t take_state(dds::Reader<T> &reader, Store &&store);
  std::size_t take_replies();
  std::size_t take_drivers();
  std::size_t take_pictures();
  void choose();
  [[nodiscard]] std::string others_text() const;

  std::uint32_t domain_;
  Duration presence_wait_;
  std::string client_;
  std::uint64_t next_id_ = 1;
  dds::Participant participant_;
  // In this order: endpoints are announced in the order of their creation. A daemon whose health has arrived therefore
  // knows both ends of the control path.
  std::optional<Control> control_;
  dds::Reader<wire::RegistrationState> registration_;
  dds::Reader<wire::FiducialReport> fiducials_;
  dds::Reader<wire::AccuracyState> accuracy_;
  dds::Reader<wire::NavigationState> navigation_;
  dds::Reader<wire::DeformationState> deformation_;
  dds::Reader<wire::Alarm> alarms_;
  dds::Reader<wire::SystemHealth> health_;
  dds::Reader<wire::DriverHealth> drivers_;
  std::optional<Pictures> pictures_;
  dds::Peers peers_;
  std::int64_t next_peers_ns_ = 0; // when they are updated next
  dds::WaitSet wait_;
  Now now_; // of the current take
  Daemons daemons_;
  std::map<std::uint64_t, dds::Guid> participants_; // of the writers that were heard
  std::map<std::string, Received<wire::DriverHealth>> driver_health_;
  std::map<std::string, dds::Guid> driver_participants_; // of those in driver_health_
  std::map<std::string, Received<wire::TrackerFrame>> trackers_;
  std::map<std::uint64_t, wire::CommandReply> arrived_replies_;
  std::set<std::uint64_t> to_devices_; // ids of commands that a device answers
};

// A command of the table (idl/commands.hpp) from its values. An invalid value is an error that names it.
[[nodiscard]] base::Result<wire::Command> make_command(wire::CommandKind kind,
                                                       std::initializer_list<std::string_view> values = {});

} // namespace bregma::live
