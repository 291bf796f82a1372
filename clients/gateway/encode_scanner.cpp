#include "clients/gateway/encode_scanner.hpp"

#include <algorithm>

#include "clients/gateway/encode.hpp"
#include "clients/gateway/record_fields.hpp"
#include "clients/gateway/record_store.hpp"
#include "idl/validity.hpp"

namespace bregma::gateway {

Scanner scanner_record(const wire::ScannerRegistration &state, bool daemon_alive,
                       const std::function<double(std::int64_t)> &ms) {
  Scanner out{};
  copy_name(out.device, state.device);
  out.time_ms = ms(state.time_ns);
  out.step = state.step;
  out.activity = daemon_alive ? state.activity : bregma_wire_SCANNER_ACTIVITY_UNKNOWN;
  copy_text(out.text, state.text);
  if (daemon_alive) {
    copy_text(out.next, state.next);
  }
  copy_name(out.protocol, state.protocol);
  out.slices = state.slices;
  out.slices_expected = state.slices_expected;
  out.slices_taken = static_cast<double>(state.slices_taken);
  out.slices_refused = static_cast<double>(state.slices_refused);
  out.slices_corrected = static_cast<double>(state.slices_corrected);
  copy_text(out.refused_text, state.refused_text);
  out.revision = state.revision;
  out.verdict = state.verdict;
  copy_text(out.reason, state.reason);
  out.fre_mm = state.fre_mm;
  out.fre_expected_mm = state.fre_expected_mm;
  out.tre_95_mm = state.tre_95_mm;
  out.verified_mm = state.verified_mm;
  out.opme_mm = state.opme_mm;
  out.change_mm = state.change_mm;
  out.change_rad = state.change_rad;
  out.validity = daemon_alive ? state.validity : bregma_wire_SCANNER_VALIDITY_UNKNOWN;
  copy_text(out.validity_text, state.validity_text);
  out.accepted_revision = state.accepted_revision;
  out.accepted_ms = ms(state.accepted_time_ns);
  out.accepted_tre_95_mm = state.accepted_tre_95_mm;
  if (out.validity == bregma_wire_SCANNER_VALID) {
    copy_pose(out.accepted_rotation, out.accepted_translation_mm, state.accepted_T_base_scanner);
  } else {
    fill_unknown(out.accepted_rotation);
    fill_unknown(out.accepted_translation_mm);
  }
  out.accepted_corrected = state.accepted_corrected ? 1 : 0;
  out.field_status = state.field_status;
  copy_name(out.field, state.field);
  out.field_made_ms = ms(state.field_made_ns);
  out.field_expires_ms = ms(state.field_expires_ns);
  out.field_points = state.field_points;
  out.field_initial_mm = state.field_initial_mm;
  out.field_residual_mm = state.field_residual_mm;
  out.field_residual_max_mm = state.field_residual_max_mm;
  out.phantom_moved_mm = state.phantom_moved_mm;
  return out;
}

std::vector<ScannerCoil> scanner_coil_records(const wire::ScannerRegistration &state) {
  std::vector<ScannerCoil> out;
  const std::uint32_t count = std::min<std::uint32_t>(state.coil_count, bregma_wire_MAX_COILS);
  for (std::uint32_t i = 0; i < count; ++i) {
    const wire::CoilReport &coil = state.coils[i];
    ScannerCoil &record = out.emplace_back();
    copy_name(record.device, state.device);
    copy_name(record.coil, coil.coil);
    record.outcome = coil.outcome;
    copy_numbers(record.scanner_mm, coil.scanner_mm);
    record.sigma_mm = coil.sigma_mm;
    record.residual_mm = coil.residual_mm;
  }
  return out;
}

RobotTool robot_tool_record(const live::Received<wire::RobotTool> &state, bool daemon_alive, std::int64_t now_ns) {
  RobotTool out{};
  copy_name(out.device, state.device);
  copy_name(out.tool, state.tool);
  out.frame = static_cast<double>(state.frame);
  out.mode = state.mode;
  out.status = state.status;
  out.scanner_status = state.scanner_status;
  copy_name(out.scanner, state.scanner);
  out.acquired_ms = out.published_ms = kNan;
  // The end does not depend on when it is computed, so that a state is the same record until then.
  std::int64_t end_ns = 0;
  if (state.arrival.transit_ns) {
    const std::int64_t published_ns = state.arrival.boot_ns - *state.arrival.transit_ns;
    out.published_ms = to_ms(published_ns);
    if (state.acquired_time_ns > 0 && state.age_ns >= 0) {
      out.acquired_ms = to_ms(published_ns - state.age_ns);
    }
    end_ns = published_ns + std::clamp<std::int64_t>(state.valid_for_ns, 0, wire::kMaxLiveAge_ns);
  }
  blank_poses(out);
  if (daemon_alive && now_ns < end_ns && state.status == bregma_wire_POSE_LIVE) {
    out.status = state.status;
    out.valid_until_ms = to_ms(end_ns);
    copy_pose(out.rotation, out.tip_mm, state.T_base_tip);
    copy_numbers(out.covariance, state.covariance);
    if (state.scanner_status == bregma_wire_POSE_LIVE) {
      out.scanner_status = state.scanner_status;
      copy_pose(out.scanner_rotation, out.scanner_tip_mm, state.T_scanner_tip);
      copy_numbers(out.scanner_covariance, state.scanner_covariance);
      out.scanner_error_95_mm = state.scanner_error_95_mm;
    }
  }
  return out;
}

} // namespace bregma::gateway
