// Points on the skin from an arm that carries a range sensor: p = T_base_flange (o + d u), with the flange interpolated
// at the time at which the filtered reading held, and the calibrated beam (o, u) and curve of the sensor.
//
// The filter is Hampel's over the sensor's window; its delay and that of the sensor are removed from the time
// (algorithms/range/range_filters.hpp). One value per window is used, so that the values are independent.
//
// The error of a point has two parts. The reading, the flange and the time give an independent one per point. Beam and
// curve, with what the curve does not fit, give one that all points of a scan have in common; it does not average out,
// and goes into the registration as a whole. What the sensor reads too far on tilted skin depends on the skin, and is
// not taken off here: the registration estimates it from the points and the directions of their beams.
//
// With a tracker beside the arm a point is one of the tracked reference, p_reference = T_tracker_reference^-1
// T_base_tracker^-1 p, both interpolated at the same time, so that the patient may move. The error of the hand-eye
// calibration is common to all points.
//
// A reading is dropped, and counted, where no flange is known at its time: the arm is silent, or repeats its values to
// the bit; so is one without the reference: hidden, refused, or contradicting the hand-eye calibration. The scan is
// interrupted until it is started anew when another driver sends for arm or sensor, or the arm jumps: a person has to
// see what has changed.
//
// Units mm, rad, ns UTC of the host. One thread; tables are bounded; a step may allocate.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "algorithms/calibration/beam.hpp"
#include "algorithms/range/power_law.hpp"
#include "algorithms/range/range_filters.hpp"
#include "server/session/messages.hpp"
#include "server/stages/pose_history.hpp"
#include "server/stages/robot_tool/tool_pose.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

class SurfaceScan {
public:
  static constexpr std::size_t kMaxFlanges = 512;
  static constexpr std::size_t kMaxWaiting = 256; // values whose flange has not come yet
  static constexpr std::size_t kMaxReferences = 128;
  static constexpr std::int64_t kWait_ns = 500'000'000;  // for a flange and a reference
  static constexpr double kMaxFlangeSpeed_mm_s = 2000.0; // faster is a jump

  struct Point {
    std::uint64_t frame = 0; // of the newest reading in it
    std::int64_t time_ns = 0;
    geometry::Vector3d position_mm = geometry::Vector3d::Zero(); // in the arm's base, or in the reference
    geometry::Matrix3d independent_mm2 = geometry::Matrix3d::Zero();
    geometry::Matrix3d common_mm2 = geometry::Matrix3d::Zero();
    // Unit, against the beam, and across it, fixed in the flange; in the same frame as the position.
    geometry::Vector3d towards_sensor = geometry::Vector3d::UnitZ();
    geometry::Vector3d across = geometry::Vector3d::UnitX();
  };
  // Of the present or last scan.
  struct Counts {
    std::uint64_t readings = 0;     // that arrived
    std::uint64_t missing = 0;      // without a value
    std::uint64_t out_of_range = 0; // nearer or farther than the calibration allows
    std::uint64_t without_flange = 0;
    std::uint64_t without_reference = 0;
    std::uint64_t overflown = 0; // a table was full
    std::uint64_t placed = 0;    // values that became a position, used or not
  };
  enum class Interruption : std::uint8_t { kNone, kArmReplaced, kSensorReplaced, kArmJumped };

  explicit SurfaceScan(const ToolPoseOptions &options) : options_(options) {}

  // on: begins anew with this calibration; else the scan ends.
  void request(const ScanRequest &request);
  void add(const FlangeSample &sample);
  void add(const ReferenceSample &sample);
  void add(const RangeReading &reading, std::int64_t now_ns);
  // The next point that is spacing_mm from the last one; nullopt: none yet. Call it until then.
  [[nodiscard]] std::optional<Point> next(std::int64_t now_ns);

  [[nodiscard]] bool on() const { return request_.on; }
  [[nodiscard]] const ScanRequest &request() const { return request_; }
  [[nodiscard]] const Counts &counts() const { return counts_; }
  [[nodiscard]] Interruption interruption() const { return interruption_; }
  // When a value was placed last, or the scan began.
  [[nodiscard]] std::int64_t placed_ns() const { return placed_ns_; }

private:
  using Flanges = PoseHistory<geometry::frame::RobotBase, geometry::frame::RobotFlange, kMaxFlanges>;
  using References = PoseHistory<geometry::frame::Tracker, geometry::frame::Reference, kMaxReferences>;
  struct Value {
    std::uint64_t frame = 0;
    std::int64_t time_ns = 0;
    double range_mm = 0.0; // as the sensor states
    double sigma_mm = 0.0;
  };
  // Whether what was measured of the time is all that will be.
  [[nodiscard]] bool settled(std::int64_t time_ns) const;
  [[nodiscard]] Point point_of(const Value &value, const Flanges::Pose &T_base_flange) const;
  // The same point of the reference.
  [[nodiscard]] Point in_reference(const Point &in_base, const References::Pose &T_tracker_reference) const;
  [[nodiscard]] bool in_range(double range_mm) const;

  ToolPoseOptions options_;
  ScanRequest request_{};
  std::optional<range::WindowFilter> filter_;
  calibration::BeamResult beam_;                            // with its covariance
  calibration::BeamResult exact_;                           // without
  geometry::Vector3d across_ = geometry::Vector3d::UnitX(); // the beam, in the flange
  range::RangeCurve curve_;                                 // of the request, if curved
  Flanges flanges_;
  References references_;
  geometry::UncertainPose<geometry::frame::Tracker, geometry::frame::RobotBase> T_tracker_base_; // beside a tracker
  std::deque<Value> waiting_;    // in the order of their times
  double sigma_sum_mm_ = 0.0;    // of the readings since the last value
  std::int64_t since_value_ = 0; // readings since the last value
  std::int64_t valid_ = 0;       // of them with a value
  std::int64_t last_reading_ns_ = 0;
  std::optional<std::uint32_t> arm_, sensor_; // incarnations
  std::optional<geometry::Vector3d> last_point_mm_;
  Interruption interruption_ = Interruption::kNone;
  Counts counts_;
  std::int64_t placed_ns_ = 0;
};

} // namespace bregma::server
