#include "tests/faults/arm_run.hpp"

#include <algorithm>
#include <cmath>
#include <exception>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "idl/names.hpp"
#include "tests/component/robot/robot_operator.hpp"

namespace bregma::faults {

namespace {

using Eigen::Vector3d;

constexpr std::uint64_t kArmPatientSeed = 5;
constexpr std::int64_t kShownLimit_ns = 100'000'000;
constexpr double kArmAlarm_s = 1.0, kArmBack_s = 3.0;
constexpr double kFilter_s = 0.3; // points of readings before the fault still come out of the sensor's filter
constexpr double kRetry_s = 0.5;
constexpr double kArmJump_mm = 30.0;
const Vector3d kMoved_mm(8.0, -5.0, 6.0); // of an arm's base or a tracker
constexpr double kUnchecked_s = 5.0;      // until the alarm says that nothing checks hand-eye

class ArmRun {
public:
  ArmRun(const Cell &cell, During session)
      : cell_(cell), session_(session), case_(kArmPatientSeed, cell.subject == Subject::kBesideArm),
        room_(case_, kArmPatientSeed), person_(case_, room_) {}

  Outcome execute() {
    const std::int64_t began_ns = room_.now();
    try {
      prepare();
      cell_.subject == Subject::kScanSensor ? meet_sensor() : meet_arm();
    } catch (const std::exception &error) {
      violate("not back", error.what());
    }
    return {violations_, figures_, static_cast<double>(room_.now() - began_ns) * 1e-9};
  }

private:
  void prepare() {
    person_.begin();
    if (session_ >= During::kRegistered) {
      person_.register_by_touches();
    }
    if (session_ >= During::kVerified) {
      person_.verify();
    }
    if (session_ == During::kNavigating) {
      person_.done(bregma_wire_COMMAND_START_NAVIGATION, {"Pointer", ""});
    }
    room_.run(1.0);
  }

  void set_fault(bool on) {
    room_.deliver_arm = !(on && (cell_.link.cut || cell_.content == Content::kOtherDriver));
    if (!on && cell_.content == Content::kOtherDriver) {
      ++room_.arm_writer;
    }
    room_.hide_flange_body = on && cell_.content == Content::kHiddenFlangeBody;
    room_.hide_reference = on && cell_.content == Content::kHiddenReference;
    const Vector3d moved = on ? kMoved_mm : Vector3d(Vector3d::Zero());
    if (cell_.content == Content::kPushedBase) {
      room_.push_base(moved);
    } else if (cell_.content == Content::kBumpedTracker) {
      room_.bump_tracker(moved);
    }
    room_.tamper = [](wire::RobotState &) {};
    if (on && cell_.content == Content::kJump) {
      room_.tamper = [](wire::RobotState &state) { state.T_base_flange.translation_mm[0] += kArmJump_mm; };
    } else if (on && cell_.content == Content::kOtherTool) {
      room_.tamper = [](wire::RobotState &state) { (void)wire::set_name(state.tool, "Drill"); };
    } else if (on && cell_.content == Content::kFrozen) {
      room_.tamper = room_.frozen_values();
    }
  }

  void meet_arm() {
    const casefile::Case &loaded = case_.loaded();
    // The arm moves while the fault begins.
    room_.start_move(
        {room_.touching(loaded.fiducials[0].position_mm, 60.0), room_.touching(loaded.fiducials[1].position_mm, 60.0)},
        30.0);
    begin_ns_ = room_.now();
    watch(1.0, false);
    room_.states.clear();
    room_.alarms.clear();
    const std::uint64_t lost = room_.device("Robot")->lost;
    begin_ns_ = room_.now();
    set_fault(true);
    // Where no pose needs to end each one shown must be true.
    watch(cell_.lasts_s, cell_.expect.max_gap_ms == 0.0);
    set_fault(false);
    const std::int64_t end_ns = room_.now();
    const bool poses = session_ >= During::kRegistered;
    if (poses) {
      come_back(end_ns);
    }
    check_alarm();
    room_.run(1.0); // the next health
    const std::uint64_t counted = room_.device("Robot")->lost - lost;
    if (cell_.link.cut && counted != room_.undelivered) { // another driver counts for itself
      violate("not counted",
              std::to_string(counted) + " lost, " + std::to_string(room_.undelivered) + " samples never arrived");
    }
    if (!poses) { // the registration goes on, or begins anew where its samples are void
      finish_motion();
      person_.done(bregma_wire_COMMAND_START_REGISTRATION);
      person_.register_by_touches();
    }
  }

  // A deadman that is released during a motion would latch a stop.
  void finish_motion() {
    room_.run(60.0, [&] { return room_.phase() == bregma_wire_MOTION_DONE; });
    room_.release_deadman();
    room_.run(0.5);
  }

  // Poses again after the fault: by themselves, or after a check touch where a person must look first. An arm that was
  // frozen while it moved may be either.
  void come_back(std::int64_t end_ns) {
    const auto back = [&] {
      return room_.run(kArmBack_s, [&] { return !room_.states.empty() && test::shown(room_.states.back()); });
    };
    const auto look = [&] {
      finish_motion();
      (void)person_.touch(bregma_wire_COMMAND_CHECK_TOUCH, case_.loaded().landmarks[0]);
    };
    if (cell_.expect.reverify) {
      watch(2.0, true);
      look();
    }
    bool shown = back();
    if (!shown && cell_.content == Content::kFrozen) {
      look();
      shown = back();
    }
    if (shown) {
      figures_.back_ms = static_cast<double>(room_.now() - end_ns) * 1e-6;
      watch(1.0, false);
    } else {
      violate("not back", "no pose is shown after the fault");
    }
  }

  void meet_sensor() {
    const auto path = room_.raster(40.0, 50.0, 8.0);
    person_.move({path.front()}, 80.0);
    person_.done(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"});
    room_.start_move(path, 20.0);
    if (!room_.run(10.0, [&] { return room_.points.size() > 20; })) {
      throw std::runtime_error("the scan gives no points");
    }
    room_.alarms.clear();
    begin_ns_ = room_.now();
    room_.unplug_sensor();
    if (cell_.content == Content::kSwapped) {
      room_.plug_sensor("B7");
    }
    room_.run(kFilter_s);
    const std::size_t before = room_.points.size();
    room_.run(cell_.lasts_s);
    const bool replugged = cell_.content == Content::kReplugged;
    if (!replugged) {
      check_alarm();
    }
    room_.plug_sensor("A4"); // the right one is there again, and nobody has said so
    room_.run(kArmBack_s);
    if (replugged) {
      check_alarm();
    }
    if (room_.points.size() != before) {
      violate("trusted",
              std::to_string(room_.points.size() - before) + " points before a person has restarted the scan");
    }
    person_.done(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {"Robot"});
    person_.done(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"});
    const std::int64_t restarted_ns = room_.now();
    if (!room_.run(kArmBack_s, [&] { return room_.points.size() > before; })) {
      violate("not back", "no point after the scan was restarted");
    }
    figures_.back_ms = static_cast<double>(room_.now() - restarted_ns) * 1e-6;
  }

  // Judges every state that is published in this time. faulty: the arm's data are false or missing, so that no pose may
  // be shown after the limit; otherwise the true tip must be where each pose allows it.
  void watch(double seconds, bool faulty) {
    const double quantile = uncertainty::chi_square_upper_quantile(Judge::kTail, 3);
    std::size_t seen = room_.states.size();
    room_.run(seconds, [&] {
      const Vector3d truth = room_.tip_in_image();
      for (; seen < room_.states.size(); ++seen) {
        const wire::NavigationState &state = room_.states[seen];
        if (!test::shown(state)) {
          continue;
        }
        ++figures_.shown;
        const std::int64_t since_ns = state.published_time_ns - begin_ns_;
        if (faulty) {
          figures_.oldest_shown_ms = std::max(figures_.oldest_shown_ms, static_cast<double>(since_ns) * 1e-6);
          if (since_ns > kShownLimit_ns) {
            violate(room_.deliver_arm && cell_.expect.reverify ? "trusted" : "too old",
                    "a pose is shown although the arm's data are false");
          }
          continue;
        }
        const Eigen::Matrix<double, 6, 6, Eigen::RowMajor> covariance =
            Eigen::Matrix<double, 6, 6, Eigen::RowMajor>::Map(state.covariance);
        const Vector3d tip = Vector3d::Map(state.T_image_tip.translation_mm);
        const Eigen::Matrix3d position = uncertainty::tre_covariance(covariance, tip);
        const double ratio = (truth - tip).dot(position.ldlt().solve(truth - tip));
        figures_.largest_error_ratio = std::max(figures_.largest_error_ratio, ratio);
        if (!(ratio <= quantile)) {
          violate("outside", "the true tip is not where the state's covariance allows it");
        }
      }
      return false;
    });
  }

  void check_alarm() {
    if (session_ < cell_.expect.alarm_from) {
      return;
    }
    for (const wire::Alarm &alarm : room_.alarms) {
      const std::string text = wire::text(alarm.kind) + " " + wire::text(alarm.subject);
      const bool named = std::any_of(cell_.expect.alarm.begin(), cell_.expect.alarm.end(),
                                     [&](const std::string &word) { return text.find(word) != std::string::npos; });
      if (named && alarm.state == bregma_wire_ALARM_RAISED) {
        figures_.alarm_ms = static_cast<double>(alarm.raised_time_ns - begin_ns_) * 1e-6;
        break;
      }
    }
    const double within_ms =
        1e3 * (kArmAlarm_s + (cell_.content == Content::kReplugged ? cell_.lasts_s + kFilter_s : 0.0) +
               (cell_.content == Content::kHiddenFlangeBody ? kUnchecked_s : 0.0));
    if (!(figures_.alarm_ms >= 0.0 && figures_.alarm_ms <= within_ms)) {
      violate("no alarm", "within " + std::to_string(static_cast<int>(within_ms)) + " ms");
    }
  }

  void violate(const char *rule, const std::string &text) {
    const auto known = std::find_if(violations_.begin(), violations_.end(),
                                    [rule](const Violation &violation) { return violation.rule == rule; });
    if (known != violations_.end()) {
      ++known->count;
      return;
    }
    violations_.push_back({rule, text, static_cast<double>(room_.now() - begin_ns_) * 1e-6, 1});
  }

  const Cell &cell_;
  During session_;
  test::RobotCase case_;
  test::RobotRoom room_;
  test::RobotOperator person_;
  std::int64_t begin_ns_ = 0; // of the fault
  std::vector<Violation> violations_;
  Figures figures_;
};

} // namespace

bool is_arm_cell(const Cell &cell) {
  return cell.subject == Subject::kArm || cell.subject == Subject::kBesideArm || cell.subject == Subject::kScanSensor;
}

bool meets_arm(const Cell &cell, During session) {
  return cell.subject != Subject::kScanSensor ? session >= During::kRegistering && session <= During::kNavigating
                                              : session == During::kRegistering || session == During::kNavigating;
}

Outcome run_arm(const Cell &cell, During session) { return ArmRun(cell, session).execute(); }

} // namespace bregma::faults
