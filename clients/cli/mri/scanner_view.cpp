#include "clients/cli/mri/scanner_view.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>

#include <Eigen/Core>

#include "algorithms/geometry/angles.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"

namespace bregma::cli {

namespace {

using nlohmann::json;

template <std::size_t N> std::string_view word_of(const std::array<std::string_view, N> &words, std::int32_t value) {
  return value >= 0 && static_cast<std::size_t>(value) < N ? words[static_cast<std::size_t>(value)] : kNotKnownHere;
}

template <std::size_t N> std::string plain(const char (&text)[N]) {
  return printable(std::string_view(text, strnlen(text, N)));
}

std::size_t coil_count(const wire::ScannerRegistration &state) {
  return std::min<std::size_t>(state.coil_count, std::size(state.coils));
}

json pose_json(const wire::Pose &pose) {
  json q = json::array(), t = json::array();
  for (const double v : pose.rotation_wxyz) {
    q.push_back(json_number(v));
  }
  for (const double v : pose.translation_mm) {
    t.push_back(json_number(v));
  }
  return {{"rotation_wxyz", q}, {"translation_mm", t}};
}

std::string field_text(const wire::ScannerRegistration &state) {
  if (state.field_status != bregma_wire_FIELD_VALID && state.field_status != bregma_wire_FIELD_EXPIRED) {
    return "Field: none\n";
  }
  std::string out = "Field: " + plain(state.field) +
                    (state.field_status == bregma_wire_FIELD_EXPIRED ? ", expired: not used" : ", valid");
  if (state.field_points > 0) {
    out += "; " + std::to_string(state.field_points) + " control points, distortion " +
           fixed(state.field_initial_mm, 2, "mm") + ", " + fixed(state.field_residual_mm, 2, "mm") + " (largest " +
           fixed(state.field_residual_max_mm, 2) + ") left at points held out, phantom moved by " +
           fixed(state.phantom_moved_mm, 2, "mm");
  }
  return out + "\n";
}

} // namespace

std::string_view scanner_step_label(wire::ScannerStep value) {
  static constexpr std::array<std::string_view, 11> kWords{
      "unknown", "idle", "scout", "phantom", "swap", "frame scout", "top", "bottom", "verify", "accept", "done"};
  return word_of(kWords, value);
}

std::string_view scanner_activity_label(wire::ScannerActivity value) {
  static constexpr std::array<std::string_view, 7> kWords{"unknown",  "none",     "waits for you", "switches coils",
                                                          "acquires", "computes", "failed"};
  return word_of(kWords, value);
}

std::string_view scanner_verdict_label(wire::ScannerVerdict value) {
  static constexpr std::array<std::string_view, 7> kWords{"unknown",      "none",      "found",  "inaccurate",
                                                          "inconsistent", "ambiguous", "refused"};
  return word_of(kWords, value);
}

std::string_view scanner_validity_label(wire::ScannerValidity value) {
  static constexpr std::array<std::string_view, 6> kWords{"unknown",     "none",        "valid",
                                                          "table moved", "frame moved", "field expired"};
  return word_of(kWords, value);
}

std::string_view coil_outcome_label(wire::CoilOutcome value) {
  static constexpr std::array<std::string_view, 6> kWords{"unknown", "not seen", "used", "outlier", "verifies", "idle"};
  return word_of(kWords, value);
}

std::string scanner_line(const wire::ScannerRegistration &state) {
  std::string out = std::string(scanner_step_label(state.step)) + ", " +
                    std::string(scanner_activity_label(state.activity)) + ": " + plain(state.text);
  if (state.slices_expected > 0) {
    out += ", " + std::to_string(state.slices) + " of " + std::to_string(state.slices_expected) + " slices";
  }
  return out + "; next: " + plain(state.next);
}

std::string scanner_text(const wire::ScannerRegistration &state) {
  std::string out = scanner_line(state) + "\n" + field_text(state);
  out += "Estimate: " + std::string(scanner_verdict_label(state.verdict)) +
         (state.reason[0] != '\0' ? ", " + plain(state.reason) : "") + "\n";
  if (state.verdict == bregma_wire_SCANNER_VERDICT_FOUND || state.verdict == bregma_wire_SCANNER_VERDICT_INACCURATE) {
    out += "Predicted error at the target " + fixed(state.tre_95_mm, 2, "mm") +
           " (95 %); consistency of the coils (FRE) " + fixed(state.fre_mm, 2, "mm") + ", expected " +
           fixed(state.fre_expected_mm, 2, "mm") + ", p " + fixed(state.p_value, 3) + "; out of plane " +
           fixed(state.opme_mm, 2, "mm") + "; coils that verify " + fixed(state.verified_mm, 2, "mm") + "; change " +
           fixed(state.change_mm, 2, "mm") + ", " +
           fixed(state.change_rad / geometry::kRadiansPerDegree, 2, "degrees") + "\n";
  }
  Table table({"Coil", "", "x mm", "y mm", "z mm", "Sigma mm", "Residual mm"});
  bool any = false;
  for (std::size_t i = 0; i < coil_count(state); ++i) {
    const wire::CoilReport &coil = state.coils[i];
    if (coil.outcome == bregma_wire_COIL_IDLE) {
      continue;
    }
    any = true;
    table.row({plain(coil.coil), std::string(coil_outcome_label(coil.outcome)), fixed(coil.scanner_mm[0], 2),
               fixed(coil.scanner_mm[1], 2), fixed(coil.scanner_mm[2], 2), fixed(coil.sigma_mm, 2),
               fixed(coil.residual_mm, 2)});
  }
  out += any ? "\n" + table.text() + "\n" : "";
  out += "Accepted: " + std::string(scanner_validity_label(state.validity)) +
         (state.validity_text[0] != '\0' ? ", " + plain(state.validity_text) : "");
  if (state.validity == bregma_wire_SCANNER_VALID) {
    out += ", revision " + std::to_string(state.accepted_revision) + ", predicted error at the target " +
           fixed(state.accepted_tre_95_mm, 2, "mm") + " (95 %)" +
           (state.accepted_corrected ? "" : ", without a distortion field");
  }
  out += "\n";
  out += "Slices: " + std::to_string(state.slices_taken) + " taken, " + std::to_string(state.slices_refused) +
         " refused, " + std::to_string(state.slices_corrected) + " corrected" +
         (state.refused_text[0] != '\0' ? "; the last refused: " + plain(state.refused_text) : "") + "\n";
  return out;
}

json scanner_json(const wire::ScannerRegistration &state) {
  json coils = json::array();
  for (std::size_t i = 0; i < coil_count(state); ++i) {
    const wire::CoilReport &coil = state.coils[i];
    coils.push_back({{"coil", plain(coil.coil)},
                     {"outcome", coil_outcome_label(coil.outcome)},
                     {"scanner_mm", json_vector(Eigen::Vector3d::Map(coil.scanner_mm))},
                     {"sigma_mm", json_number(coil.sigma_mm)},
                     {"residual_mm", json_number(coil.residual_mm)}});
  }
  return {{"scanner", plain(state.device)},
          {"time_ns", state.time_ns},
          {"step", scanner_step_label(state.step)},
          {"activity", scanner_activity_label(state.activity)},
          {"text", plain(state.text)},
          {"next", plain(state.next)},
          {"protocol", plain(state.protocol)},
          {"slices", state.slices},
          {"slices_expected", state.slices_expected},
          {"slices_taken", state.slices_taken},
          {"slices_refused", state.slices_refused},
          {"slices_corrected", state.slices_corrected},
          {"refused_text", plain(state.refused_text)},
          {"revision", state.revision},
          {"verdict", scanner_verdict_label(state.verdict)},
          {"reason", plain(state.reason)},
          {"T_base_scanner", pose_json(state.T_base_scanner)},
          {"fre_mm", json_number(state.fre_mm)},
          {"fre_expected_mm", json_number(state.fre_expected_mm)},
          {"p_value", json_number(state.p_value)},
          {"predicted_error_95_mm", json_number(state.tre_95_mm)},
          {"verified_rms_mm", json_number(state.verified_mm)},
          {"out_of_plane_mm", json_number(state.opme_mm)},
          {"change_mm", json_number(state.change_mm)},
          {"change_rad", json_number(state.change_rad)},
          {"duration_ms", json_number(state.duration_ms)},
          {"coils", coils},
          {"validity", scanner_validity_label(state.validity)},
          {"validity_text", plain(state.validity_text)},
          {"accepted_revision", state.accepted_revision},
          {"accepted_T_base_scanner", pose_json(state.accepted_T_base_scanner)},
          {"accepted_error_95_mm", json_number(state.accepted_tre_95_mm)},
          {"accepted_corrected", state.accepted_corrected},
          {"field", plain(state.field)},
          {"field_valid", state.field_status == bregma_wire_FIELD_VALID},
          {"field_expires_ns", state.field_expires_ns},
          {"field_points", state.field_points},
          {"field_initial_mm", json_number(state.field_initial_mm)},
          {"field_residual_mm", json_number(state.field_residual_mm)},
          {"field_residual_max_mm", json_number(state.field_residual_max_mm)},
          {"phantom_moved_mm", json_number(state.phantom_moved_mm)}};
}

} // namespace bregma::cli
