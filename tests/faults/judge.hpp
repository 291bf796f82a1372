// The judge of one run: compares what the daemon and the displays say with the truth that the simulated room and the
// line know. It uses none of the daemon's own times, ages or counts as evidence.
//
// The rules, all for the published states and, where it says so, for the displays:
//   too old      a shown pose is at most max(100 ms, three frame periods) and 300 ms old, from its true exposure
//                (displays too); a device that is called live has sent within that time
//   outside      the true tip at the time of publication is where the state's covariance allows it (tail kTail)
//   not finite   a shown pose has finite values
//   unusable     no pose of a malformed sample is shown; every shown pose is of a frame that has arrived
//   understated  the stated age is at most 5 ms too small
//   gap          poses that are not concerned by the fault do not pause (displays too)
//   not counted  taken + rejected = arrived, lost = the numbers that never arrived
//   no alarm     within 1 s
//   false alarm  a critical alarm, where the fault gives no reason
//   no reply     a command is not answered, or not as what it is
//   not back     poses are shown again within 3 s of the fault's end; the session goes on
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "tests/faults/cell.hpp"
#include "tests/faults/display.hpp"
#include "tests/faults/faulty_line.hpp"
#include "tests/support/virtual_operation.hpp"

namespace bregma::faults {

struct Violation {
  std::string rule;
  std::string text;      // of the first one
  double after_ms = 0.0; // since the fault began
  std::uint64_t count = 0;
};

struct Figures {
  double oldest_shown_ms = 0.0; // true age of a published live or unverified pose
  double oldest_displayed_ms = 0.0;
  double age_understated_ms = 0.0;
  double largest_error_ratio = 0.0; // Mahalanobis distance of the true tip, squared
  double alarm_ms = -1.0;           // from the fault's begin to the expected alarm; -1: none
  double gap_ms = 0.0;              // longest pause of shown poses while the tool was seen
  double back_ms = -1.0;            // from the fault's end to the next shown pose
  std::uint64_t shown = 0;          // published poses
};

class Judge {
public:
  static constexpr double kTail = 1e-6;

  Judge(const Cell &cell, During session, const std::string &tool, std::uint64_t seed,
        test::VirtualOperation &operation, FaultyLine &line);

  // After the run. failure: of the operator's script; empty if it came to its end.
  void finish(const std::string &failure);

  [[nodiscard]] const std::vector<Violation> &violations() const { return violations_; }
  [[nodiscard]] const Figures &figures() const { return figures_; }

private:
  struct Shown { // a published pose that waits for the truth of its time
    std::int64_t published_ns;
    Eigen::Vector3d tip_mm;
    Eigen::Matrix3d covariance;
    std::string tool;
  };
  struct Truth {
    std::int64_t time_ns;
    std::map<std::string, Eigen::Vector3d> tips_mm;
  };
  struct Raised {
    std::int64_t time_ns;
    std::string text;
  };
  // Pauses of the navigated tool's poses, of the daemon or of one display.
  struct Watch {
    const char *who;
    std::int64_t shown_ns = 0;  // the last pose, or the last time at which the tool was not seen
    std::int64_t absent_ns = 0; // since the fault's end: time for which the tool was seen and not shown
    bool back = false;
  };

  void on_room(const sim::RoomOutput &sent);
  void on_state(const wire::NavigationState &state);
  void on_alarm(const wire::Alarm &alarm);
  void check_values(const wire::NavigationState &state);
  void check_age(const wire::NavigationState &state, const FrameTruth &frame);
  void check_errors();
  void check_error(const Shown &shown, const Truth &before, const Truth &after);
  void draw(Display &display, Watch &watch);
  void saw(Watch &watch, std::int64_t exposure_ns);
  void check_pause(Watch &watch, bool seen, std::int64_t since_last_ns, bool may_pause);
  void check_devices();
  void check_counts();
  void check_count(const wire::DeviceHealth &device, const DeviceLedger &ledger);
  void check_alarm();
  void check_replies();

  void violate(const char *rule, const std::string &text);
  [[nodiscard]] std::int64_t now_ns() const { return operation_.now_ns(); }
  [[nodiscard]] FaultTime fault() const { return {line_.begin_ns(), line_.end_ns()}; }
  [[nodiscard]] bool began() const { return line_.begin_ns() != 0 && now_ns() >= line_.begin_ns(); }
  [[nodiscard]] bool ended() const { return began() && now_ns() >= line_.end_ns(); }
  [[nodiscard]] bool poses_expected() const { return session_ >= During::kRegistered; }
  [[nodiscard]] bool in_grace(std::int64_t time_ns) const;

  Cell cell_;
  During session_;
  std::string tool_;
  test::VirtualOperation &operation_;
  FaultyLine &line_;
  Display faulty_display_, other_display_;
  std::deque<Shown> waiting_;
  std::deque<Truth> truths_;
  std::vector<Raised> raised_;
  std::set<std::string> standing_;                                               // alarms that are not cleared, as text
  std::map<std::pair<std::uint64_t, wire::CommandKind>, std::uint64_t> replies_; // to the faulty client
  wire::SystemHealth health_{};
  std::int64_t health_ns_ = 0; // true time at which it was published
  Watch published_{"the daemon"}, displayed_{"the faulty display"}, other_displayed_{"the other display"};
  std::int64_t room_ns_ = 0; // time of the room's last frame
  std::vector<Violation> violations_;
  Figures figures_;
};

} // namespace bregma::faults
