// A cell of the fault matrix: what fails, how, and what must be seen. tests/faults/matrix.cpp is the table.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace bregma::faults {

enum class Subject {
  kNothing,
  kTracker,
  kRobot,
  kForce,
  kRange,
  kArm,
  kBesideArm, // a tracker beside the arm, and what ties the two
  kScanSensor,
  kClient,
  kDaemon,
  kDisk,
  kClock,
  kNetwork
};
enum class Fault {
  kNone,
  kSilent,
  kLate,
  kReordered,
  kDuplicated,
  kFrozen,
  kNotFinite,
  kJumping,
  kWrongTool,
  kClockStep,
  kRestarted,
  kMalformed,
  kFlooded
};
// The session while the fault begins. Degraded: navigating, with the tracker silent since half a second.
enum class During { kIdle, kCaseLoaded, kRegistering, kRegistered, kVerified, kNavigating, kDegraded };
inline constexpr During kAllSessions[] = {During::kIdle,       During::kCaseLoaded, During::kRegistering,
                                          During::kRegistered, During::kVerified,   During::kNavigating,
                                          During::kDegraded};

[[nodiscard]] const char *name_of(Subject subject);
[[nodiscard]] const char *name_of(Fault fault);
[[nodiscard]] const char *name_of(During session);

// A faulty connection, while the fault lasts.
struct LinkFault {
  bool cut = false;
  double delay_ms = 0.0;         // added to every sample
  double ramp_ms_per_s = 0.0;    // growth of the delay
  double loss = 0.0;             // fraction of the samples
  double reordered = 0.0;        // fraction of the samples that arrive after their successor
  int copies = 1;                // how often each sample arrives
  bool new_writer_after = false; // the writer has another identity afterwards: its lease had ended
};

// How a device's samples are changed while the fault lasts.
enum class Content {
  kTrue,
  kFrozen,          // the values of the first faulty sample
  kFrozenReference, // of the reference alone
  kNotFinite,
  kNotFiniteRms,
  kJump, // 100 mm
  kJumpReference,
  kMirrored,
  kTransposed,
  kMetres,
  kResidual, // a marker is bent: another pose with a large residual
  kTwoMarkers,
  kForeignMarkers,    // bits beyond the tool's markers
  kHiddenWithMarkers, // mask against status: hidden, with all markers used
  kStrangeTool,       // one more tool, which the case does not know
  kStrangeDevice,     // another device's name
  kTooManyParts,      // a count beyond its bound
  kNoPeriod,          // period 0
  kNoName,            // a name without an end
  kDeviceClock,       // the device's clock is set; it stays so
  kDriverClock,       // the wall clock of the driver's host is set; it stays so
  kRenumbered,        // the device restarts: numbers from 1, another clock, another writer; it stays so
  kFlood,             // 20 times the stated rate; made by the room
  kSecondWriter,      // another writer of the same name, 20 mm beside
  // Of the arm that navigates, and of the range sensor that it carries (arm_run.hpp):
  kOtherTool,   // the arm states to carry another tool
  kOtherDriver, // silent, then another driver sends for it
  kUnplugged,   // the sensor's line, until the fault ends
  kReplugged,   // the same sensor, which counts anew
  kSwapped,     // another sensor
  // Of the tracker beside the arm:
  kHiddenFlangeBody,
  kHiddenReference,
  kPushedBase, // of the arm, against patient and tracker
  kBumpedTracker
};

// What happens to the daemon, its host or its disk.
enum class HostFault {
  kNone,
  kStopped,          // SIGSTOP, then SIGCONT
  kKilled,           // SIGKILL, another process starts when the fault ends
  kSecondDaemon,     // another daemon is heard on the domain
  kWallClock,        // the wall clock of the daemon's host is set; it stays so
  kRecorderFails,    // the disk is full
  kRecordsDropped,   // records do not fit
  kStateNotWritable, // the snapshot cannot be written
  kStateDamaged      // the snapshot is damaged, and the daemon is killed
};

// What a client of the daemon does while the fault lasts.
enum class ClientFault {
  kNone,
  kStopped,      // SIGSTOP of the display, then SIGCONT
  kClock,        // its wall clock is wrong from the start
  kLate,         // it joins when the fault ends
  kRepeats,      // sends each command twice
  kOtherKind,    // sends other commands with the client, id and time of an answered one
  kMalformed,    // sends commands without a valid body, of an unknown kind, with values that are not finite
  kUnknownNames, // names tools and points that the case does not have
  kFloods        // 20,000 commands per second
};

struct Expectation {
  // Words, one of which must stand in the kind, subject or text of an alarm that is raised within 1 s. Empty: no alarm
  // must come.
  std::vector<std::string> alarm{};
  During alarm_from = During::kIdle; // in earlier sessions the fault cannot be noticed, or means nothing
  bool critical = false;             // a critical alarm is right; otherwise it is a false one
  // Longest time without a pose that may be shown while the tool is seen. 0: poses may end while the fault lasts.
  double max_gap_ms = 100.0;
  // The faulty values are recognisable in one sample: none of them may be shown. Otherwise for the time of the rule.
  bool malformed = false;
  bool reverify = false;   // the verification is rightly lost
  bool idle_after = false; // the session is rightly lost
};

struct Cell {
  Subject subject{};
  Fault fault{};
  std::string variant{}; // empty if there is only one
  double lasts_s = 1.5;
  LinkFault link{};
  Content content = Content::kTrue;
  HostFault host = HostFault::kNone;
  ClientFault client = ClientFault::kNone;
  double step_s = 0.0; // of a clock
  Expectation expect{};

  // "tracker/late:500ms"
  [[nodiscard]] std::string name() const;
};

// All cells, in the order of subjects and faults.
[[nodiscard]] const std::vector<Cell> &matrix();

} // namespace bregma::faults
