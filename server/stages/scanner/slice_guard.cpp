#include "server/stages/scanner/slice_guard.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

#include "server/inputs/payload_check.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

constexpr std::int64_t kTakeOver_ns = 2'000'000'000; // silence after which another writer may send
constexpr std::int64_t kFuture_ns = 2'000'000'000;   // by which the device's clock may run ahead within a series
constexpr std::int64_t kMaxTime_ns = 4'000'000'000'000'000'000; // the year 2096: differences do not overflow
constexpr double kMaxSpacing_mm = 50.0;
constexpr double kMaxThickness_mm = 200.0;
constexpr double kMaxPosition_mm = 2'000.0; // inside a scanner

std::string count(std::uint64_t n, const char *what) { return std::to_string(n) + " " + what; }

bool is_rotation(const wire::Pose &pose) {
  const auto &q = pose.rotation_wxyz;
  const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  return std::abs(norm - 1.0) <= inputs::kRotationTolerance;
}

bool are_all_finite(const wire::ImageSlice &s) {
  const auto finite = [](double v) { return std::isfinite(v); };
  return std::all_of(std::begin(s.T_scanner_slice.rotation_wxyz), std::end(s.T_scanner_slice.rotation_wxyz), finite) &&
         std::all_of(std::begin(s.T_scanner_slice.translation_mm), std::end(s.T_scanner_slice.translation_mm),
                     finite) &&
         finite(s.spacing_mm[0]) && finite(s.spacing_mm[1]) && finite(s.thickness_mm) &&
         finite(s.bandwidth_Hz_per_pixel) && finite(s.coil_current_mA) && (!s.table_stated || finite(s.table_mm));
}

} // namespace

Eigen::Matrix3d axes_of(const wire::ImageSlice &slice) {
  const auto &q = slice.T_scanner_slice.rotation_wxyz;
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
}

SliceGuard::SliceGuard(const wire::Name &device) {
  copy_name(health_.device, device);
  health_.kind = bregma_wire_DEVICE_SCANNER;
  health_.status = bregma_wire_DEVICE_NEVER_SEEN;
}

SliceVerdict SliceGuard::check(const wire::ImageSlice &slice, std::uint64_t writer, std::int64_t now_ns) {
  if (!wire::is_terminated(slice.device) || !same(slice.device, health_.device)) {
    ++unknown_;
    return {false, bregma_wire_REJECT_UNKNOWN_DEVICE, "a slice of another scanner"};
  }
  Check wrong = check_header(slice);
  wrong = wrong ? wrong : check_writer(writer, now_ns);
  wrong = wrong ? wrong : check_order(slice, now_ns);
  wrong = wrong ? wrong : check_series(slice);
  if (wrong) {
    ++health_.rejected[wrong->reason];
    ++refused_;
    return {false, wrong->reason, wrong->text};
  }
  const bool other = arrived_ns_ != 0 && writer != writer_;
  take(slice, writer, now_ns);
  return {true, bregma_wire_REJECT_UNKNOWN, {}, other};
}

SliceGuard::Check SliceGuard::check_header(const wire::ImageSlice &s) {
  const auto malformed = [](const std::string &text) { return Refusal{bregma_wire_REJECT_MALFORMED, text}; };
  if (!wire::is_terminated(s.protocol)) {
    return malformed("its protocol is no name");
  }
  if (!are_all_finite(s)) {
    return Refusal{bregma_wire_REJECT_NOT_FINITE, "a number of its header is not finite"};
  }
  if (!is_rotation(s.T_scanner_slice)) {
    return Refusal{bregma_wire_REJECT_NOT_A_ROTATION, "its orientation is not a rotation"};
  }
  for (const double coordinate : s.T_scanner_slice.translation_mm) {
    if (std::abs(coordinate) > kMaxPosition_mm) {
      return malformed("its position is outside any scanner");
    }
  }
  if (s.columns < 2 || s.rows < 2 || std::uint64_t{s.columns} * s.rows > kMaxPixels) {
    return malformed("its size is " + std::to_string(s.columns) + " x " + std::to_string(s.rows));
  }
  if (s.pixels._length != s.columns * s.rows || s.pixels._buffer == nullptr) {
    return malformed("it has " + count(s.pixels._length, "pixels") + ", its size is " + std::to_string(s.columns) +
                     " x " + std::to_string(s.rows));
  }
  for (const double spacing : s.spacing_mm) {
    if (!(spacing > 0.0 && spacing <= kMaxSpacing_mm)) {
      return malformed("a zero, negative or implausible spacing of its pixels");
    }
  }
  if (s.thickness_mm < 0.0 || s.thickness_mm > kMaxThickness_mm || s.bandwidth_Hz_per_pixel < 0.0 ||
      s.coil_current_mA < 0.0) {
    return malformed("a negative or implausible thickness, bandwidth or current");
  }
  if (s.series == 0 || s.count == 0 || s.count > kMaxSlices || s.index == 0 || s.index > s.count) {
    return malformed("it is slice " + std::to_string(s.index) + " of " + std::to_string(s.count) + " of series " +
                     std::to_string(s.series));
  }
  if (std::uint64_t{s.columns} * s.rows * s.count > kMaxSeries) {
    return malformed("its series of " + std::to_string(s.count) + " slices of " + std::to_string(s.columns) + " x " +
                     std::to_string(s.rows) + " is too large");
  }
  for (const std::int32_t constant : {s.phase_encoding, s.read_out, s.coil_state, s.patient_position, s.correction}) {
    if (constant < 0) {
      return malformed("a negative constant in its header");
    }
  }
  const auto along_row = [](wire::ImageDirection d) {
    return d == bregma_wire_DIRECTION_ROW_POSITIVE || d == bregma_wire_DIRECTION_ROW_NEGATIVE;
  };
  if (s.read_out != bregma_wire_DIRECTION_UNKNOWN && s.phase_encoding != bregma_wire_DIRECTION_UNKNOWN &&
      along_row(s.read_out) == along_row(s.phase_encoding)) {
    return malformed("its read-out and phase encoding are parallel");
  }
  return std::nullopt;
}

SliceGuard::Check SliceGuard::check_writer(std::uint64_t writer, std::int64_t now_ns) {
  if (arrived_ns_ == 0 || writer == writer_) {
    return std::nullopt;
  }
  if (now_ns - arrived_ns_ < kTakeOver_ns) {
    ++health_.other_writer;
    return Refusal{bregma_wire_REJECT_DUPLICATE,
                   "another program sends slices of the same scanner: end one of the two, or give it another name"};
  }
  frame_ = 0; // a restarted driver counts anew
  device_time_ns_ = 0;
  first_ = {};
  seen_.clear();
  ++health_.takeovers;
  return std::nullopt;
}

SliceGuard::Check SliceGuard::check_order(const wire::ImageSlice &s, std::int64_t now_ns) const {
  if (frame_ != 0 && s.frame == frame_) {
    return Refusal{bregma_wire_REJECT_DUPLICATE, "it was received already"};
  }
  if (s.frame < frame_) {
    return Refusal{bregma_wire_REJECT_TIME_BACKWARDS, "it is older than the last one"};
  }
  if (s.device_time_ns <= 0 || s.device_time_ns > kMaxTime_ns) {
    return Refusal{bregma_wire_REJECT_MALFORMED, "it states no time"};
  }
  if (first_.series == 0 || s.series != first_.series) {
    return std::nullopt; // its clock may have been set since the last series
  }
  if (s.device_time_ns < device_time_ns_) {
    return Refusal{bregma_wire_REJECT_TIME_BACKWARDS, "it is older than the last one, or the scanner's clock was set"};
  }
  if (s.device_time_ns - now_ns - lead_ns_ > kFuture_ns) {
    return Refusal{bregma_wire_REJECT_TIME_IN_FUTURE, "its time is in the future: the scanner's clock was set"};
  }
  return std::nullopt;
}

SliceGuard::Check SliceGuard::check_series(const wire::ImageSlice &s) const {
  if (first_.series == 0 || s.series != first_.series) {
    return std::nullopt;
  }
  const std::string series = "series " + std::to_string(s.series);
  const auto malformed = [](const std::string &text) { return Refusal{bregma_wire_REJECT_MALFORMED, text}; };
  if (s.count != first_.count || s.columns != first_.columns || s.rows != first_.rows ||
      !same(s.protocol, first_.protocol)) {
    return malformed("it does not belong to " + series + ": another size, number of slices or protocol");
  }
  if (seen_[s.index - 1]) {
    return Refusal{bregma_wire_REJECT_DUPLICATE,
                   "slice " + std::to_string(s.index) + " of " + series + " was received already"};
  }
  if ((axes_of(s) - axes_of(first_)).cwiseAbs().maxCoeff() > kSameDirection) {
    return malformed("mixed orientations in " + series);
  }
  if (std::abs(s.spacing_mm[0] - first_.spacing_mm[0]) > 1e-6 ||
      std::abs(s.spacing_mm[1] - first_.spacing_mm[1]) > 1e-6) {
    return malformed("mixed spacings in " + series);
  }
  if (s.patient_position != first_.patient_position || s.correction != first_.correction ||
      s.coil_state != first_.coil_state || s.coils_on != first_.coils_on || s.read_out != first_.read_out ||
      std::abs(s.bandwidth_Hz_per_pixel - first_.bandwidth_Hz_per_pixel) > 1e-6 * first_.bandwidth_Hz_per_pixel) {
    return malformed("patient position, correction, read-out, bandwidth or coils change within " + series);
  }
  return std::nullopt;
}

void SliceGuard::take(const wire::ImageSlice &s, std::uint64_t writer, std::int64_t now_ns) {
  if (arrived_ns_ == 0 || writer != writer_) {
    ++health_.connections;
  }
  health_.lost += frame_ != 0 && s.frame > frame_ + 1 ? s.frame - frame_ - 1 : 0;
  ++health_.taken;
  writer_ = writer;
  arrived_ns_ = now_ns;
  frame_ = s.frame;
  device_time_ns_ = s.device_time_ns;
  if (s.series != first_.series) {
    lead_ns_ = s.device_time_ns - now_ns;
    first_ = s;
    first_.pixels = {}; // they belong to the caller
    seen_.assign(s.count, false);
  }
  seen_[s.index - 1] = true;
}

inputs::StreamHealth SliceGuard::health(std::int64_t now_ns) const noexcept {
  inputs::StreamHealth out;
  out.device_count = 1;
  out.devices[0] = health_;
  wire::DeviceHealth &device = out.devices[0];
  // A scanner sends nothing between series: it is lost only when its program is gone.
  device.status = arrived_ns_ == 0 ? bregma_wire_DEVICE_NEVER_SEEN
                  : writers_ == 0  ? bregma_wire_DEVICE_LOST
                                   : bregma_wire_DEVICE_LIVE;
  device.age_ms = arrived_ns_ == 0 ? wire::kUnknown : 1e-6 * static_cast<double>(now_ns - arrived_ns_);
  device.rate_hz = device.latency_p50_ms = device.latency_p99_ms = wire::kUnknown;
  device.clock_offset_ms = device.clock_drift_ppm = device.transit_ms = wire::kUnknown;
  out.unknown_device_samples = unknown_;
  return out;
}

} // namespace bregma::server
