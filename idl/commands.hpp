// The table of commands with the name and body of each. Command line, session, simulator and tests use it to make,
// check, name and print commands. A new command needs one constant and possibly one form in control.idl, one row below,
// and for a new form its fields in commands.cpp.
//
// Threads: any. Functions that return an error sentence return an empty one on success.
#pragma once

#include <array>
#include <cstddef>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

#include "idl/topics.hpp"

namespace bregma::wire {

// SystemHealth::daemon, and the receiver of a command that names one.
inline constexpr std::string_view kDaemonName = "bregmad";

struct CommandField {
  enum class Type : std::uint8_t { kName, kPath, kNumber, kCount }; // Name, string<1023>, double, unsigned long
  const char *label;                                                // shown to users
  Type type;
  std::size_t offset; // in CommandBody
  bool may_be_empty = false;
};

struct CommandEntry {
  CommandKind kind;
  const char *name; // in logs
  const char *deed; // completes "cannot ..."
  CommandForm form;
};

#define BREGMA_COMMAND(name, deed, form)                                                                               \
  CommandEntry { bregma_wire_COMMAND_##name, #name, deed, bregma_wire_FORM_##form }
inline constexpr std::array kCommands{
    BREGMA_COMMAND(LOAD_CASE, "load a case", FOLDER),
    BREGMA_COMMAND(START_PIVOT, "start a pivot calibration", TOOL),
    BREGMA_COMMAND(FINISH_PIVOT, "finish a pivot calibration", TOOL),
    BREGMA_COMMAND(START_REGISTRATION, "start a registration", EMPTY),
    BREGMA_COMMAND(CAPTURE_FIDUCIAL, "capture a fiducial", TOUCH),
    BREGMA_COMMAND(REMOVE_FIDUCIAL, "remove a fiducial", POINT),
    BREGMA_COMMAND(START_TRACE, "trace the surface", TOOL),
    BREGMA_COMMAND(STOP_TRACE, "stop a trace", TOOL),
    BREGMA_COMMAND(ACCEPT_REGISTRATION, "accept a registration", EMPTY),
    BREGMA_COMMAND(CHECK_TOUCH, "check a landmark", TOUCH),
    BREGMA_COMMAND(CONFIRM_VERIFICATION, "confirm the verification", EMPTY),
    BREGMA_COMMAND(START_NAVIGATION, "start the navigation", PLAN),
    BREGMA_COMMAND(STOP_NAVIGATION, "stop the navigation", EMPTY),
    BREGMA_COMMAND(ACKNOWLEDGE_ALARM, "acknowledge an alarm", ALARM),
    BREGMA_COMMAND(CLOSE_CASE, "close the case", EMPTY),
    BREGMA_COMMAND(START_SCANNER_REGISTRATION, "register a scanner", DEVICE),
    BREGMA_COMMAND(CONFIRM_SCANNER_STEP, "confirm a step of the scanner's registration", STEP),
    BREGMA_COMMAND(ACCEPT_SCANNER_REGISTRATION, "accept the scanner's registration", DEVICE),
    BREGMA_COMMAND(ACQUIRE_SERIES, "acquire a series", SERIES),
    BREGMA_COMMAND(SET_COILS, "set coils", COILS),
    BREGMA_COMMAND(START_SURFACE_SCAN, "scan the surface", SCAN),
    BREGMA_COMMAND(STOP_SURFACE_SCAN, "stop a surface scan", DEVICE),
    BREGMA_COMMAND(MOVE_TO_TRAJECTORY, "move the guide", MOTION),
    BREGMA_COMMAND(HOLD_ROBOT, "hold the robot", DEVICE),
    BREGMA_COMMAND(STOP_ROBOT, "stop the robot", DEVICE),
    BREGMA_COMMAND(RESET_ROBOT, "reset the robot's stop", DEVICE),
    BREGMA_COMMAND(RESET_SCANNER_REGISTRATION, "reset the scanner's registration", DEVICE)};
#undef BREGMA_COMMAND

// The fields of a form, in the order of the values. Empty also for a form that is unknown to this program.
[[nodiscard]] std::span<const CommandField> fields_of(CommandForm form) noexcept;

// nullptr if the kind is unknown to this program.
[[nodiscard]] constexpr const CommandEntry *find_command(CommandKind kind) noexcept {
  for (const CommandEntry &entry : kCommands) {
    if (entry.kind == kind) {
      return &entry;
    }
  }
  return nullptr;
}

// "CAPTURE_FIDUCIAL"; "command 77" for a kind that is unknown to this program.
[[nodiscard]] std::string command_name(CommandKind kind);

// The text of a name or a path.
[[nodiscard]] std::string_view text_of(const CommandBody &body, const CommandField &field) noexcept;

// Sets kind and body from values in the order of fields_of(). Missing values are empty.
[[nodiscard]] std::string fill_command(Command &out, CommandKind kind, std::span<const std::string_view> values);
[[nodiscard]] inline std::string fill_command(Command &out, CommandKind kind,
                                              std::initializer_list<std::string_view> values) {
  return fill_command(out, kind, std::span(values.begin(), values.size()));
}

// The error in a received command of a known kind: the form of its body, an unterminated name, a number that is not
// finite. The receiver checks whether the names exist.
[[nodiscard]] std::string malformed(const Command &command);

// The answer to a command that was received whole, without a value. session: as far as the answering process knows one.
[[nodiscard]] CommandReply reply_to(const Command &command, CommandResult result, std::string_view text,
                                    SessionState session = bregma_wire_SESSION_UNKNOWN);

} // namespace bregma::wire
