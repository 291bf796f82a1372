// What a client has received from the daemon that it follows.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "idl/topics.hpp"
#include "idl/validity.hpp"

namespace bregma::live {

// This process's clocks at one time. Ages and silences are counted with boot_ns (CLOCK_BOOTTIME); utc_ns may step, and
// is only shown.
struct Now {
  std::int64_t boot_ns = 0;
  std::int64_t utc_ns = 0;
  [[nodiscard]] static Now read();
};

template <class T> struct Received : T { wire::Arrival arrival; };

// A copy of wire::DeformationField, whose arrays belong to DDS.
struct Field {
  std::string model;
  std::int64_t time_ns = 0;
  wire::DeformationStatus status = 0;
  std::vector<float> displacement_mm;
  std::vector<float> von_mises_Pa;
};

// A copy of wire::CorrectedSlice, whose pixels belong to DDS: `said` has none.
struct Slice {
  wire::CorrectedSlice said{};
  std::vector<std::uint16_t> pixels; // row by row
  wire::Arrival arrival;
};

// The latest values. Empty if none has arrived; an instance that has ended is removed.
struct Snapshot {
  std::optional<Received<wire::SystemHealth>> health;
  std::optional<wire::RegistrationState> registration;
  std::optional<wire::FiducialReport> fiducials;
  std::optional<wire::AccuracyState> accuracy;
  std::map<std::string, Received<wire::NavigationState>> tools;        // by tool
  std::map<std::string, Received<wire::DeformationState>> deformation; // by point
  std::map<std::pair<std::string, std::string>, wire::Alarm> alarms;   // by kind and subject
  // Only for the role kDisplay: the captured points by tool in the order of capture, and the field while it is wanted.
  std::map<std::string, std::vector<wire::CapturedPoint>> captures;
  std::uint64_t captures_revision = 0; // incremented when they change
  std::optional<Field> field;
  std::uint64_t field_revision = 0;
  std::map<std::string, Slice> slices; // by scanner, only for the role kDisplay and while they are wanted
  std::uint64_t slices_revision = 0;
  std::map<std::string, wire::ScannerRegistration> scanners;    // by scanner, only for the role kDisplay
  std::map<std::string, Received<wire::RobotTool>> robot_tools; // by arm, only for the role kDisplay
  // The daemon's clock minus CLOCK_BOOTTIME of this host, and this host's wall clock minus the daemon's clock.
  std::optional<std::int64_t> daemon_clock_ns;
  std::optional<std::int64_t> clock_difference_ns;

  // The same whichever daemon is followed.
  std::map<std::string, Received<wire::DriverHealth>> drivers;  // per device
  std::map<std::string, Received<wire::TrackerFrame>> trackers; // per device; only for the role kDisplay
  bool no_writer = false;    // DDS knows no living daemon: the process has ended, stands still, or its link is cut
  std::uint32_t changes = 0; // number of times that another daemon was followed, because the one before was lost
  std::string other_daemons; // who else writes the daemon's topics, as a text; empty: none
  std::string other_wire;    // participants with another wire generation, as a text; empty: none
  std::string mismatches;    // endpoints of this program that do not match another's, as a text; empty: none
};

// Health is broadcast twice per second by default. After this time without it the daemon has stopped or does not
// respond, and none of its values may be shown as current.
inline constexpr std::int64_t kDaemonSilent_ns = 2'000'000'000;

// After this time without a new state, a tool's or a prediction's status is no longer current either. Poses end
// earlier, by the rule for live poses (idl/validity.hpp).
inline constexpr std::int64_t kStateSilent_ns = 500'000'000;

// Time since the daemon's last sign of life; empty before the first.
[[nodiscard]] std::optional<std::int64_t> silence_ns(const Snapshot &snapshot, std::int64_t now_boot_ns);
// False also if there has never been a daemon.
[[nodiscard]] bool alive(const Snapshot &snapshot, std::int64_t now_boot_ns);
// Present time on the daemon's clock, for the times that it stated; empty before its first sample.
[[nodiscard]] std::optional<std::int64_t> daemon_now_ns(const Snapshot &snapshot, std::int64_t now_boot_ns);

} // namespace bregma::live
