#include "clients/cli/prediction_view.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"

namespace bregma::cli {

PredictionView view_prediction(const live::Received<wire::DeformationState> &state, const DaemonView &daemon,
                               const live::Now &now) {
  PredictionView out;
  out.point = printable(wire::view(state.point));
  out.kind = followed_label(state.kind);
  std::copy_n(state.imaged_mm, 3, out.imaged_mm);
  // A sample that was received late is as old as it says.
  const std::int64_t since_arrival_ns = now.boot_ns - state.arrival.boot_ns;
  out.status =
      stale_text(daemon, daemon.now_ns ? std::max(since_arrival_ns, *daemon.now_ns - state.time_ns) : since_arrival_ns);
  if (!out.status.empty()) {
    return out;
  }
  out.status = deformation_label(state.status);
  if (state.reason != bregma_wire_DEFORMATION_REASON_NONE) {
    out.status += " (" + std::string(deformation_reason_label(state.reason)) + ")";
  }
  out.fresh = state.status == bregma_wire_DEFORMATION_VALID || state.status == bregma_wire_DEFORMATION_EXTRAPOLATING;
  if (!out.fresh) {
    return out;
  }
  out.phase = phase_label(state.phase);
  std::copy_n(state.displaced_mm, 3, out.predicted_mm);
  out.motion_mm = std::hypot(out.predicted_mm[0] - out.imaged_mm[0], out.predicted_mm[1] - out.imaged_mm[1],
                             out.predicted_mm[2] - out.imaged_mm[2]);
  out.error_bound_mm = state.error_bound_mm;
  out.von_mises_Pa = state.von_mises_Pa;
  out.tip_force_N = state.tip_force_N;
  out.shaft_force_N = state.shaft_force_N;
  out.measured_force_N = state.measured_force_N;
  out.depth_mm = state.depth_mm;
  out.ruptures = state.ruptures;
  out.rupture_force_N = state.rupture_force_N;
  out.stiffness_scale = state.stiffness_scale;
  return out;
}

std::string prediction_line(const PredictionView &view) {
  std::string out =
      view.point + (view.kind == followed_label(bregma_wire_FOLLOWED_LANDMARK) ? " (landmark): " : ": ") + view.status;
  if (!view.fresh) {
    return out;
  }
  out += "; predicted " + fixed(view.motion_mm, 2, "mm") + " from where it was imaged, +/- " +
         fixed(view.error_bound_mm, 2, "mm") + "; probe: " + view.phase;
  if (view.phase != phase_label(bregma_wire_PROBE_OUTSIDE)) {
    out += ", tip " + fixed(view.tip_force_N, 3, "N") + ", shaft " + fixed(view.shaft_force_N, 3, "N") + ", depth " +
           fixed(view.depth_mm, 1, "mm");
  }
  return out;
}

nlohmann::json prediction_json(const PredictionView &view) {
  const auto triple = [](const double(&v)[3]) {
    return nlohmann::json{json_number(v[0]), json_number(v[1]), json_number(v[2])};
  };
  return {{"kind", view.kind},
          {"status", view.status},
          {"fresh", view.fresh},
          {"imaged_mm", triple(view.imaged_mm)},
          {"predicted_mm", triple(view.predicted_mm)},
          {"motion_mm", json_number(view.motion_mm)},
          {"error_bound_mm", json_number(view.error_bound_mm)},
          {"von_mises_Pa", json_number(view.von_mises_Pa)},
          {"phase", view.phase},
          {"tip_force_N", json_number(view.tip_force_N)},
          {"shaft_force_N", json_number(view.shaft_force_N)},
          {"measured_force_N", json_number(view.measured_force_N)},
          {"depth_mm", json_number(view.depth_mm)},
          {"ruptures", view.ruptures},
          {"rupture_force_N", json_number(view.rupture_force_N)},
          {"stiffness_scale", json_number(view.stiffness_scale)}};
}

} // namespace bregma::cli
