#include "clients/gateway/encode.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <limits>

#include "clients/gateway/encode_scanner.hpp"
#include "clients/gateway/record_fields.hpp"
#include "clients/gateway/session_text.hpp"
#include "idl/names.hpp"

namespace bregma::gateway {
namespace {

constexpr std::int64_t kClockJitter_ns = 500'000;
constexpr std::int64_t kTrackerSilent_ns = 500'000'000;
constexpr std::size_t kMaxSlicePixels = std::size_t{2048} * 2048;

void copy_ellipsoid(double (&semi_axes_mm)[3], double (&axes)[9], const wire::Ellipsoid &ellipsoid) {
  copy_numbers(semi_axes_mm, ellipsoid.semi_axes_mm);
  copy_numbers(axes, ellipsoid.axes);
}

} // namespace

struct Encoder::Context {
  const live::Snapshot &snapshot;
  live::Now now;
  bool alive;
  std::optional<std::int64_t> clock_ns;

  // Of a time on the daemon's clock.
  [[nodiscard]] double ms(std::int64_t daemon_time_ns) const {
    return clock_ns && daemon_time_ns > 0 ? to_ms(daemon_time_ns - *clock_ns) : kNan;
  }
};

Tool tool_record(const live::Received<wire::NavigationState> &state, bool daemon_alive, std::int64_t now_ns) {
  Tool out{};
  copy_name(out.tool, state.tool);
  out.frame = static_cast<double>(state.frame);
  out.acquired_ms = out.published_ms = out.age_sigma_ms = out.valid_until_ms = kNan;
  out.status = state.status;
  out.session = state.session;
  out.plausibility = state.plausibility;
  out.plausibility_reason = state.plausibility_reason;
  out.source_kind = state.source_kind;
  copy_name(out.source, state.source);
  copy_name(out.trajectory, state.trajectory); // the choice of a plan does not depend on a pose
  if (state.arrival.transit_ns) {
    const std::int64_t published_ns = state.arrival.boot_ns - *state.arrival.transit_ns;
    out.published_ms = to_ms(published_ns);
    if (state.acquired_time_ns > 0 && state.age_ns >= 0) {
      out.acquired_ms = to_ms(published_ns - state.age_ns);
    }
    out.age_sigma_ms = state.age_sigma_ns > 0 ? to_ms(state.age_sigma_ns) : kNan;
  }
  // The end does not depend on when it is computed, so that a state is the same record until then.
  const std::int64_t left_ns = wire::remaining_ns(state, state.arrival, state.arrival.boot_ns);
  const std::int64_t end_ns = state.arrival.boot_ns + left_ns;
  if (!daemon_alive || left_ns <= 0 || now_ns >= end_ns) {
    blank_pose(out);
    return out;
  }
  out.valid_until_ms = to_ms(end_ns);
  copy_pose(out.rotation, out.tip_mm, state.T_image_tip);
  copy_numbers(out.velocity_mm_s, state.velocity_mm_s);
  copy_numbers(out.covariance, state.covariance);
  copy_numbers(out.position_velocity_covariance_mm2_s, state.position_velocity_covariance_mm2_s);
  copy_numbers(out.velocity_covariance_mm2_s2, state.velocity_covariance_mm2_s2);
  out.acceleration_sigma_mm_s2 = state.acceleration_sigma_mm_s2;
  out.tre_rms_mm = state.tre_rms_mm;
  copy_ellipsoid(out.tre_95_semi_axes_mm, out.tre_95_axes, state.tre_95);
  const bool planned = out.trajectory[0] != '\0';
  out.distance_to_target_mm = planned ? state.distance_to_target_mm : kNan;
  out.lateral_deviation_mm = planned ? state.lateral_deviation_mm : kNan;
  out.angle_rad = planned ? state.angle_rad : kNan;
  out.remaining_depth_mm = planned ? state.remaining_depth_mm : kNan;
  out.prediction = state.prediction;
  const bool predicted = planned && (state.prediction == bregma_wire_DEFORMATION_VALID ||
                                     state.prediction == bregma_wire_DEFORMATION_EXTRAPOLATING);
  if (predicted) {
    copy_numbers(out.predicted_target_mm, state.predicted_target_mm);
  } else {
    fill_unknown(out.predicted_target_mm);
  }
  out.distance_to_predicted_target_mm = predicted ? state.distance_to_predicted_target_mm : kNan;
  copy_name(out.nearest_structure, state.nearest_structure);
  const bool near = out.nearest_structure[0] != '\0';
  out.nearest_structure_mm = near ? state.nearest_structure_mm : kNan;
  out.nearest_structure_sigma_mm = near ? state.nearest_structure_sigma_mm : kNan;
  return out;
}

// Without its pixels.
SliceHeader Encoder::slice_header(const live::Slice &slice, const Context &context) {
  const wire::CorrectedSlice &said = slice.said;
  const wire::ImageSlice &image = said.slice;
  SliceHeader out{};
  copy_name(out.device, said.device);
  out.published_ms = context.ms(said.published_time_ns);
  out.number = static_cast<double>(image.frame);
  out.columns = image.columns;
  out.rows = image.rows;
  copy_numbers(out.spacing_mm, image.spacing_mm);
  out.thickness_mm = image.thickness_mm;
  copy_pose(out.rotation, out.translation_mm, image.T_scanner_slice);
  copy_pose(out.image_rotation, out.image_translation_mm, said.T_image_slice);
  copy_name(out.protocol, image.protocol);
  out.series = image.series;
  out.index = image.index;
  out.count = image.count;
  out.correction = image.correction;
  out.max_shift_mm = said.max_shift_mm;
  out.error_95_mm = said.error_95_mm;
  out.extrapolated_fraction = said.extrapolated_fraction;
  out.missing_fraction = said.missing_fraction;
  out.tip_status = said.tip_status;
  if (said.tip_status == bregma_wire_POSE_LIVE) {
    copy_name(out.tip_tool, said.tip_tool);
    copy_numbers(out.tip_pixel, said.tip_pixel);
    out.tip_distance_mm = said.tip_distance_mm;
    copy_numbers(out.tip_direction, said.tip_direction);
    out.tip_error_95_mm = said.tip_error_95_mm;
  } else {
    fill_unknown(out.tip_pixel);
    fill_unknown(out.tip_direction);
    out.tip_distance_mm = out.tip_error_95_mm = kNan;
  }
  return out;
}

// The estimate of the transit moves the clock by microseconds: a record that is otherwise the same would be news.
void Encoder::follow_clock(const live::Snapshot &snapshot) {
  const auto &clock = snapshot.daemon_clock_ns;
  if (!clock || !daemon_clock_ns_ || std::abs(*clock - *daemon_clock_ns_) > kClockJitter_ns) {
    daemon_clock_ns_ = clock;
  }
}

bool Encoder::encode(const live::Snapshot &snapshot, const live::Now &now) {
  follow_clock(snapshot);
  if (snapshot.changes != changes_) {
    changes_ = snapshot.changes;
    captures_revision_ = field_revision_ = slices_revision_ = ~std::uint64_t{0}; // those of another daemon
  }
  const Context context{snapshot, now, live::alive(snapshot, now.boot_ns), daemon_clock_ns_};
  bool news = encode_tools(context);
  news |= encode_link(context);
  news |= encode_registration(context);
  news |= encode_accuracy(context);
  news |= encode_deformation(context);
  news |= encode_slices(context);
  news |= encode_scanners(context);
  news |= encode_captures(context);
  news |= encode_alarms(context);
  news |= encode_health(context);
  news |= encode_trackers(context);
  return news;
}

bool Encoder::encode_link(const Context &context) {
  const live::Snapshot &snapshot = context.snapshot;
  Link link{};
  link.presence = !snapshot.health ? 0 : context.alive ? 2 : 1;
  if (link.presence == presence_ && context.now.boot_ns < next_link_ns_) {
    return false;
  }
  presence_ = link.presence;
  next_link_ns_ = context.now.boot_ns + kLinkPeriod_ns;
  const auto silent_ns = live::silence_ns(snapshot, context.now.boot_ns);
  link.silent_ms = silent_ns ? to_ms(*silent_ns) : kNan;
  link.last_state_ms = kNan;
  for (const auto &[name, tool] : snapshot.tools) {
    if (tool.arrival.transit_ns) { // else the state may be old
      link.last_state_ms = std::fmax(link.last_state_ms, to_ms(tool.arrival.boot_ns - *tool.arrival.transit_ns));
    }
  }
  link.changes = snapshot.changes;
  Session session{};
  if (snapshot.health) {
    link.wire_generation = snapshot.health->wire_generation;
    link.wire_revision = snapshot.health->wire_revision;
    copy_name(link.host, snapshot.health->host);
    session.session = context.alive ? snapshot.health->session : bregma_wire_SESSION_UNKNOWN;
    session.time_ms = context.ms(snapshot.health->time_ns);
    wire::set_text(session.next, context.alive ? next_step_text(snapshot) : std::string());
  } else {
    session.time_ms = kNan;
  }
  wire::set_text(link.text, link_text(snapshot, context.alive));
  constexpr std::array kKinds{RecordKind::kLink, RecordKind::kSession};
  return store_.replace(kKinds, {make_record(RecordKind::kLink, link), make_record(RecordKind::kSession, session)});
}

bool Encoder::encode_tools(const Context &context) {
  std::vector<Record> records;
  for (const auto &[name, state] : context.snapshot.tools) {
    const Tool tool = tool_record(state, context.alive, context.now.boot_ns);
    records.push_back(make_record(RecordKind::kTool, tool, state.arrival.boot_ns));
  }
  constexpr std::array kKinds{RecordKind::kTool};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_registration(const Context &context) {
  std::vector<Record> records;
  if (const auto &state = context.snapshot.registration; state && !wire::view(state->reference).empty()) {
    Registration out{};
    copy_name(out.reference, state->reference);
    out.time_ms = context.ms(state->time_ns);
    out.revision = static_cast<double>(state->revision);
    out.accepted_revision = static_cast<double>(state->accepted_revision);
    out.status = state->status;
    out.reason = state->reason;
    copy_name(out.subject, state->subject);
    copy_text(out.text, state->text);
    copy_pose(out.rotation, out.translation_mm, state->T_image_reference);
    copy_pose(out.accepted_rotation, out.accepted_translation_mm, state->accepted_T_image_reference);
    out.fiducials = state->fiducial_count;
    out.surface_samples = state->surface_count;
    out.fre_mm = state->fre_mm;
    out.fre_expected_mm = state->fre_expected_mm;
    out.surface_rms_mm = state->surface_rms_mm;
    records.push_back(make_record(RecordKind::kRegistration, out));
  }
  if (const auto &report = context.snapshot.fiducials) {
    for (const auto &fiducial :
         std::span(report->fiducials).first(std::min<std::size_t>(report->count, std::size(report->fiducials)))) {
      Fiducial out{};
      copy_name(out.fiducial, fiducial.fiducial);
      copy_numbers(out.residual_mm, fiducial.residual_mm);
      out.norm_mm = fiducial.norm_mm;
      out.leave_one_out_mm = fiducial.leave_one_out_mm;
      out.p_value = fiducial.p_value;
      out.suspect = fiducial.suspect ? 1 : 0;
      records.push_back(make_record(RecordKind::kFiducial, out));
    }
  }
  constexpr std::array kKinds{RecordKind::kRegistration, RecordKind::kFiducial};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_accuracy(const Context &context) {
  std::vector<Record> records;
  if (const auto &state = context.snapshot.accuracy; state && !wire::view(state->reference).empty()) {
    Accuracy out{};
    copy_name(out.reference, state->reference);
    out.time_ms = context.ms(state->time_ns);
    out.fre_mm = state->fre_mm;
    out.fre_expected_mm = state->fre_expected_mm;
    out.last_check_mm = state->last_check_mm;
    out.last_check_limit_mm = state->last_check_limit_mm;
    out.drift_statistic = state->drift_statistic;
    out.drift_threshold = state->drift_threshold;
    out.checks = state->check_count;
    out.drift_detected = state->drift_detected ? 1 : 0;
    records.push_back(make_record(RecordKind::kAccuracy, out));
    for (const auto &target :
         std::span(state->targets).first(std::min<std::size_t>(state->target_count, std::size(state->targets)))) {
      Target one{};
      copy_name(one.target, target.target);
      one.tre_rms_mm = target.tre_rms_mm;
      copy_numbers(one.covariance_mm2, target.covariance_mm2);
      copy_ellipsoid(one.tre_95_semi_axes_mm, one.tre_95_axes, target.tre_95);
      one.image_rms_mm = target.image_rms_mm;
      records.push_back(make_record(RecordKind::kTarget, one));
    }
  }
  constexpr std::array kKinds{RecordKind::kAccuracy, RecordKind::kTarget};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_deformation(const Context &context) {
  std::vector<Record> records;
  for (const auto &[name, state] : context.snapshot.deformation) {
    Deformation out{};
    copy_name(out.point, state.point);
    out.time_ms = context.ms(state.time_ns);
    out.kind = state.kind;
    const bool current = context.alive && context.now.boot_ns - state.arrival.boot_ns < live::kStateSilent_ns;
    out.status = current ? state.status : bregma_wire_DEFORMATION_UNKNOWN;
    out.reason = current ? state.reason : bregma_wire_DEFORMATION_REASON_UNKNOWN;
    out.phase = current ? state.phase : bregma_wire_PROBE_UNKNOWN;
    copy_numbers(out.imaged_mm, state.imaged_mm);
    const auto shown = [current](double value) { return current ? value : kNan; };
    const bool predicted =
        out.status == bregma_wire_DEFORMATION_VALID || out.status == bregma_wire_DEFORMATION_EXTRAPOLATING;
    std::transform(std::begin(state.displaced_mm), std::end(state.displaced_mm), out.displaced_mm,
                   [predicted](double value) { return predicted ? value : kNan; });
    out.error_bound_mm = shown(state.error_bound_mm);
    out.von_mises_Pa = shown(state.von_mises_Pa);
    out.tip_force_N = shown(state.tip_force_N);
    out.shaft_force_N = shown(state.shaft_force_N);
    out.measured_force_N = shown(state.measured_force_N);
    out.depth_mm = shown(state.depth_mm);
    out.rupture_force_N = shown(state.rupture_force_N);
    out.stiffness_scale = shown(state.stiffness_scale);
    out.behind_ms = shown(state.behind_ms);
    out.ruptures = state.ruptures;
    out.elements = state.elements;
    records.push_back(make_record(RecordKind::kDeformation, out));
  }
  constexpr std::array kKinds{RecordKind::kDeformation};
  bool news = store_.replace(kKinds, records);

  const auto &field = context.snapshot.field;
  const std::uint64_t revision = context.snapshot.field_revision;
  const bool due = revision != field_revision_ && context.now.boot_ns >= next_field_ns_;
  if (due || !field) {
    records.clear();
    if (field) {
      FieldHeader out{};
      wire::set_text(out.model, field->model);
      out.time_ms = context.ms(field->time_ns);
      out.status = field->status;
      out.nodes = static_cast<std::uint32_t>(field->displacement_mm.size() / 3);
      out.stresses = static_cast<std::uint32_t>(field->von_mises_Pa.size());
      records.push_back(make_field_record(out, field->displacement_mm, field->von_mises_Pa));
    }
    constexpr std::array kFieldKinds{RecordKind::kField};
    news |= store_.replace(kFieldKinds, records);
    field_revision_ = revision;
    next_field_ns_ = context.now.boot_ns + kFieldPeriod_ns;
  }
  return news;
}

bool Encoder::encode_slices(const Context &context) {
  if (context.snapshot.slices_revision == slices_revision_) {
    return false;
  }
  slices_revision_ = context.snapshot.slices_revision;
  std::vector<Record> records;
  for (const auto &[name, slice] : context.snapshot.slices) {
    const wire::ImageSlice &image = slice.said.slice;
    if (slice.pixels.empty() || slice.pixels.size() != std::size_t{image.columns} * image.rows ||
        slice.pixels.size() > kMaxSlicePixels) {
      continue;
    }
    records.push_back(make_slice_record(slice_header(slice, context), slice.pixels));
  }
  constexpr std::array kKinds{RecordKind::kSlice};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_scanners(const Context &context) {
  const auto ms = [&](std::int64_t daemon_time_ns) { return context.ms(daemon_time_ns); };
  std::vector<Record> records;
  for (const auto &[name, state] : context.snapshot.scanners) {
    records.push_back(make_record(RecordKind::kScanner, scanner_record(state, context.alive, ms)));
    for (const ScannerCoil &coil : scanner_coil_records(state)) {
      records.push_back(make_record(RecordKind::kScannerCoil, coil));
    }
  }
  for (const auto &[name, state] : context.snapshot.robot_tools) {
    const RobotTool tool = robot_tool_record(state, context.alive, context.now.boot_ns);
    records.push_back(make_record(RecordKind::kRobotTool, tool, state.arrival.boot_ns));
  }
  constexpr std::array kKinds{RecordKind::kScanner, RecordKind::kScannerCoil, RecordKind::kRobotTool};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_captures(const Context &context) {
  if (context.snapshot.captures_revision == captures_revision_) {
    return false;
  }
  captures_revision_ = context.snapshot.captures_revision;
  std::vector<Record> records;
  for (const auto &[name, points] : context.snapshot.captures) {
    double ordinal = 0.0;
    for (const wire::CapturedPoint &point : points) {
      Capture out{};
      copy_name(out.tool, point.tool);
      out.ordinal = ordinal++;
      out.acquired_ms = context.ms(point.acquired_time_ns);
      out.frame = static_cast<double>(point.frame);
      out.kind = point.kind;
      copy_name(out.point, point.point);
      copy_numbers(out.position_mm, point.position_mm);
      copy_numbers(out.covariance_mm2, point.covariance_mm2);
      records.push_back(make_record(RecordKind::kCapture, out));
    }
  }
  constexpr std::array kKinds{RecordKind::kCapture};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_alarms(const Context &context) {
  std::vector<Record> records;
  for (const auto &[key, alarm] : context.snapshot.alarms) {
    if (alarm.state == bregma_wire_ALARM_CLEARED) {
      continue;
    }
    Alarm out{};
    copy_name(out.alarm, alarm.kind);
    copy_name(out.subject, alarm.subject);
    out.raised_ms = context.ms(alarm.raised_time_ns);
    out.changed_ms = context.ms(alarm.changed_time_ns);
    out.state = alarm.state;
    out.severity = alarm.severity;
    out.count = alarm.count;
    copy_text(out.text, alarm.text);
    records.push_back(make_record(RecordKind::kAlarm, out));
  }
  constexpr std::array kKinds{RecordKind::kAlarm};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_health(const Context &context) {
  const auto arrived_ns = context.snapshot.health ? context.snapshot.health->arrival.boot_ns : 0;
  if (arrived_ns == health_ns_ && context.alive == health_alive_) {
    return false;
  }
  health_ns_ = arrived_ns;
  health_alive_ = context.alive;
  std::vector<Record> records;
  if (const auto &health = context.snapshot.health) {
    Health out{};
    out.time_ms = context.ms(health->time_ns);
    out.started_ms = context.ms(health->started_time_ns);
    out.recorded = static_cast<double>(health->recorded);
    out.record_dropped = static_cast<double>(health->record_dropped);
    out.resident_bytes = static_cast<double>(health->resident_bytes);
    out.clock_error_ms = health->clock_error_ns > 0 ? to_ms(health->clock_error_ns) : kNan;
    out.recorder_failing = health->recorder_failing ? 1 : 0;
    out.clock_steps = health->clock_steps;
    out.other_wire = health->other_wire;
    records.push_back(make_record(RecordKind::kHealth, out));
    for (const auto &device :
         std::span(health->devices).first(std::min<std::size_t>(health->device_count, std::size(health->devices)))) {
      Device one{};
      copy_name(one.device, device.device);
      one.kind = device.kind;
      one.status = context.alive ? device.status : bregma_wire_DEVICE_STATUS_UNKNOWN;
      one.taken = static_cast<double>(device.taken);
      for (const auto count : device.rejected) {
        one.rejected += static_cast<double>(count);
      }
      one.lost = static_cast<double>(device.lost);
      one.late = static_cast<double>(device.late);
      one.connections = static_cast<double>(device.connections);
      one.rate_hz = device.rate_hz;
      one.stated_rate_hz = device.stated_rate_hz;
      one.age_ms = device.age_ms;
      one.age_sigma_ms = device.age_sigma_ms;
      one.latency_p50_ms = device.latency_p50_ms;
      one.latency_p99_ms = device.latency_p99_ms;
      one.clock_offset_ms = device.clock_offset_ms;
      one.clock_drift_ppm = device.clock_drift_ppm;
      const bool volume = device.volume_far_mm > 0.0;
      one.volume_near_mm = volume ? device.volume_near_mm : kNan;
      one.volume_far_mm = volume ? device.volume_far_mm : kNan;
      one.volume_half_width_rad = volume ? device.volume_half_width_rad : kNan;
      one.volume_half_height_rad = volume ? device.volume_half_height_rad : kNan;
      const auto driver = context.snapshot.drivers.find(wire::text(device.device));
      one.driver_state = driver == context.snapshot.drivers.end() ? bregma_wire_DRIVER_UNKNOWN : driver->second.state;
      records.push_back(make_record(RecordKind::kDevice, one));
    }
    for (const auto &loop :
         std::span(health->loops).first(std::min<std::size_t>(health->loop_count, std::size(health->loops)))) {
      Loop one{};
      copy_name(one.loop, loop.loop);
      one.rate_hz = loop.rate_hz;
      one.steps = static_cast<double>(loop.steps);
      one.overruns = static_cast<double>(loop.overruns);
      one.step_p50_us = loop.step_p50_us;
      one.step_p99_us = loop.step_p99_us;
      one.step_max_us = loop.step_max_us;
      records.push_back(make_record(RecordKind::kLoop, one));
    }
  }
  constexpr std::array kKinds{RecordKind::kHealth, RecordKind::kDevice, RecordKind::kLoop};
  return store_.replace(kKinds, records);
}

bool Encoder::encode_trackers(const Context &context) {
  if (context.now.boot_ns < next_trackers_ns_) {
    return false;
  }
  next_trackers_ns_ = context.now.boot_ns + kTrackersPeriod_ns;
  std::vector<Record> records;
  for (const auto &[name, frame] : context.snapshot.trackers) {
    const bool current = context.now.boot_ns - frame.arrival.boot_ns < kTrackerSilent_ns;
    for (const auto &tool :
         std::span(frame.tools).first(std::min<std::size_t>(frame.tool_count, std::size(frame.tools)))) {
      TrackedTool out{};
      copy_name(out.device, frame.device);
      copy_name(out.tool, tool.tool);
      out.frame = static_cast<double>(frame.frame);
      out.acquired_ms = to_ms(frame.arrival.boot_ns);
      out.status = current ? tool.status : bregma_wire_TOOL_UNKNOWN;
      const bool visible = out.status == bregma_wire_TOOL_VISIBLE || out.status == bregma_wire_TOOL_PARTLY_VISIBLE;
      out.used_markers = visible ? tool.used_markers : 0;
      if (visible) {
        copy_pose(out.rotation, out.translation_mm, tool.T_tracker_tool);
      } else {
        fill_unknown(out.rotation);
        fill_unknown(out.translation_mm);
      }
      out.marker_rms_mm = visible ? tool.marker_rms_mm : kNan;
      records.push_back(make_record(RecordKind::kTrackedTool, out));
    }
  }
  constexpr std::array kKinds{RecordKind::kTrackedTool};
  return store_.replace(kKinds, records);
}

} // namespace bregma::gateway
