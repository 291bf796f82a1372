// The protocol of an arm over its socket: text lines with a checksum (base/checked_line.hpp). Names and states are
// those of the Collaborative Robotics Toolkit (CRTK).
//
//   from the arm  identity,<name>,<serial number>,<simulated: 0 or 1>             after the connection, and when asked
//                 operating_state,<frame>,<time, us>,<DISABLED|ENABLED|PAUSED|FAULT>,<is_homed>,<is_busy>,<motion>,
//                   <waypoint>,<stopping distance, mm>,<reason>
//                 measured_js,<frame>,<time, us>,<6 positions, rad>,<6 velocities, rad/s>,<6 efforts, Nm>
//                 measured_cp,<frame>,<time, us>,<x, y, z, mm>,<quaternion w, x, y, z>      the flange in RobotBase
//                 setpoint_js,<frame>,<time, us>,<6 positions, rad>
//                 answer,<number>,<0 or 1>,<text>                                 to every message with a number
//   to the arm    enable,<number>  disable,<number>  hold,<number>  stop,<number>  reset,<number>  identity,<number>
//                 move_cp,<number>,<motion>,<index>,<count>,<speed, mm/s>,<x, y, z>,<w, x, y, z>
//                 alive,<motion>
//
// A motion begins when all of its waypoints were answered with 1 and the first `alive` with its number has arrived. The
// arm stops by itself 150 ms after the last one, and when the connection ends. A stop is a FAULT that lasts until
// reset.
//
// Pure, any thread, arbitrary bytes.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>

#include <tl/expected.hpp>

namespace bregma::arm {

inline constexpr std::size_t kMaxLine = 640; // without its end
inline constexpr std::size_t kMaxText = 80;  // printable, without comma, * and $
inline constexpr std::size_t kAxes = 6;
inline constexpr std::uint32_t kMaxWaypoints = 256;
inline constexpr std::uint64_t kMaxTime_us = 4'000'000'000'000'000;
inline constexpr std::int64_t kAlive_ns = 150'000'000;

using Axes = std::array<double, kAxes>; // finite

struct LinePose {
  std::array<double, 3> translation_mm{};          // finite
  std::array<double, 4> rotation_wxyz{1, 0, 0, 0}; // of norm 1 within 1e-3
  bool operator==(const LinePose &) const = default;
};

enum class ArmState : std::uint8_t { kDisabled, kEnabled, kPaused, kFault };
enum class FaultReason : std::uint8_t { kNone, kStop, kEmergency, kWatchdog, kLink, kLimit, kFollowing };

struct Identity {
  std::string name, serial;
  bool simulated = false;
  bool operator==(const Identity &) const = default;
};
struct OperatingState {
  std::uint64_t frame = 0, time_us = 0;
  ArmState state = ArmState::kDisabled;
  bool is_homed = false, is_busy = false;
  std::uint32_t motion = 0; // 0: none yet
  std::uint32_t waypoint = 0;
  double stop_mm = 0.0; // path of the flange until rest, if the arm were stopped now
  FaultReason reason = FaultReason::kNone;
  bool operator==(const OperatingState &) const = default;
};
struct MeasuredJs {
  std::uint64_t frame = 0, time_us = 0;
  Axes position_rad{}, velocity_rad_s{}, effort_Nm{};
  bool operator==(const MeasuredJs &) const = default;
};
struct MeasuredCp {
  std::uint64_t frame = 0, time_us = 0;
  LinePose T_base_flange;
  bool operator==(const MeasuredCp &) const = default;
};
struct SetpointJs {
  std::uint64_t frame = 0, time_us = 0;
  Axes position_rad{};
  bool operator==(const SetpointJs &) const = default;
};
struct Answer {
  std::uint32_t number = 0;
  bool ok = false;
  std::string text;
  bool operator==(const Answer &) const = default;
};
using FromArm = std::variant<Identity, OperatingState, MeasuredJs, MeasuredCp, SetpointJs, Answer>;

struct Order {
  enum class Kind : std::uint8_t { kEnable, kDisable, kHold, kStop, kReset, kIdentity } kind = Kind::kIdentity;
  std::uint32_t number = 0;
  bool operator==(const Order &) const = default;
};
struct MoveCp {
  std::uint32_t number = 0;
  std::uint32_t motion = 0;           // from 1
  std::uint32_t index = 0, count = 0; // index < count <= kMaxWaypoints
  double speed_mm_s = 0.0;            // above 0
  LinePose T_base_flange;
  bool operator==(const MoveCp &) const = default;
};
struct Alive {
  std::uint32_t motion = 0;
  bool operator==(const Alive &) const = default;
};
using ToArm = std::variant<Order, MoveCp, Alive>;

// With \r\n.
[[nodiscard]] std::string line_of(const FromArm &message);
[[nodiscard]] std::string line_of(const ToArm &message);

// Without the end of the line. The error states the problem of the line.
[[nodiscard]] tl::expected<FromArm, std::string_view> parse_from_arm(std::string_view line);
[[nodiscard]] tl::expected<ToArm, std::string_view> parse_to_arm(std::string_view line);

// For Answer::text: without what a line cannot carry, and cut to kMaxText.
[[nodiscard]] std::string line_text(std::string_view text);

} // namespace bregma::arm
