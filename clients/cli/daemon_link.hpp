// The command line's connection to a daemon: its broadcasts, and commands with their replies.
//
// Threads: one object, one thread. Errors: the constructor throws dds::Error (the domain cannot be joined); all
// other errors are returned as sentences for the user.
#pragma once

#include <chrono>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "base/result.hpp"
#include "idl/commands.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "idl/peers.hpp"

namespace bregma::cli {

// The latest values published by the daemon. Empty if none has arrived.
struct Snapshot {
  std::optional<wire::SystemHealth> health;
  std::optional<wire::RegistrationState> registration;
  std::optional<wire::FiducialReport> fiducials;
  std::optional<wire::AccuracyState> accuracy;
  std::map<std::string, wire::NavigationState> tools;                // by tool
  std::map<std::string, wire::DeformationState> deformation;         // by point
  std::map<std::string, wire::DriverHealth> drivers;                 // per device
  std::map<std::pair<std::string, std::string>, wire::Alarm> alarms; // by kind and subject
  std::string other_wire; // participants with another wire generation, as a text; empty if there are none
};

// Health is broadcast twice per second by default. After this time without it the daemon has stopped or does not
// respond, and none of its values may be shown as current.
inline constexpr std::chrono::nanoseconds kDaemonSilent = std::chrono::seconds(2);

class DaemonLink {
public:
  using Duration = std::chrono::nanoseconds;

  explicit DaemonLink(std::uint32_t domain);

  // Waits until a daemon is present and connected in both directions. The error for a daemon of another release names
  // both wire versions.
  [[nodiscard]] base::Result<void> wait_for_daemon(Duration timeout = std::chrono::seconds(3));

  // Waits for the daemon if necessary, sends, and waits for the reply to this command. A refusal is a reply (see result
  // and text), not an error.
  [[nodiscard]] base::Result<wire::CommandReply> send(wire::Command command,
                                                      Duration timeout = std::chrono::seconds(5));

  // Reads received samples; waits up to timeout if there are none. True if there were new ones.
  bool update(Duration timeout);

  // Waits until the state is complete after joining: every topic with a writer has delivered a sample, or the time has
  // elapsed.
  void settle(Duration timeout = std::chrono::milliseconds(600));

  [[nodiscard]] const Snapshot &snapshot() const { return snapshot_; }

  // Time since the daemon's last sign of life, on this host's clock; empty before the first.
  [[nodiscard]] std::optional<Duration> silence(std::int64_t now_ns) const;
  // False also if there has never been a daemon.
  [[nodiscard]] bool alive(std::int64_t now_ns) const;

  [[nodiscard]] std::uint32_t domain() const { return domain_; }
  [[nodiscard]] const std::string &client() const { return client_; } // unique to this object

private:
  [[nodiscard]] base::Error no_daemon() const;
  [[nodiscard]] bool speaks_our_wire() const;
  bool take_all();

  std::uint32_t domain_;
  std::string client_;
  std::uint64_t next_id_ = 1;
  dds::Participant participant_;
  // In this order: endpoints are announced in the order of their creation. A daemon whose health has arrived therefore
  // knows both ends of the control path.
  dds::Writer<wire::Command> commands_;
  dds::Reader<wire::CommandReply> replies_;
  dds::Reader<wire::RegistrationState> registration_;
  dds::Reader<wire::FiducialReport> fiducials_;
  dds::Reader<wire::AccuracyState> accuracy_;
  dds::Reader<wire::NavigationState> navigation_;
  dds::Reader<wire::DeformationState> deformation_;
  dds::Reader<wire::Alarm> alarms_;
  dds::Reader<wire::SystemHealth> health_;
  dds::Reader<wire::DriverHealth> drivers_;
  dds::Peers peers_;
  dds::WaitSet wait_;
  std::map<std::uint64_t, wire::CommandReply> arrived_replies_;
  Snapshot snapshot_;
};

// A command of the table (idl/commands.hpp) from its values. An invalid value is an error that names it.
[[nodiscard]] base::Result<wire::Command> make_command(wire::CommandKind kind,
                                                       std::initializer_list<std::string_view> values = {});

// Host clock, ns since the Unix epoch (UTC).
[[nodiscard]] std::int64_t utc_now_ns();

} // namespace bregma::cli
