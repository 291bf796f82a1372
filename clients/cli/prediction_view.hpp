// The part of the tissue model's answer about a target or a landmark that may be shown now, as in live_view.hpp for
// tools. The point as imaged and the point as predicted are both shown, and never one instead of the other.
#pragma once

#include "algorithms/geometry/unknown.hpp"
#include "clients/cli/live_view.hpp"

namespace bregma::cli {

// Values are NaN unless the answer is valid or extrapolating, and current.
struct PredictionView {
  std::string point;                                                                     // name
  std::string kind;                                                                      // target or landmark
  std::string status;                                                                    // with its reason
  bool fresh = false;                                                                    // the values are current
  std::string phase;                                                                     // phase of the probe
  double imaged_mm[3] = {geometry::kUnknown, geometry::kUnknown, geometry::kUnknown};    // in Image; known always
  double predicted_mm[3] = {geometry::kUnknown, geometry::kUnknown, geometry::kUnknown}; // in Image
  double motion_mm = geometry::kUnknown;                                                 // from the one to the other
  double error_bound_mm = geometry::kUnknown;                                            // of the prediction
  double von_mises_Pa = geometry::kUnknown;                                              // in the tissue at the point
  double tip_force_N = geometry::kUnknown;
  double shaft_force_N = geometry::kUnknown;
  double measured_force_N = geometry::kUnknown; // by the sensor
  double depth_mm = geometry::kUnknown;
  std::uint32_t ruptures = 0;
  double rupture_force_N = geometry::kUnknown;
  double stiffness_scale = geometry::kUnknown;
};
[[nodiscard]] PredictionView view_prediction(const live::Received<wire::DeformationState> &state,
                                             const DaemonView &daemon, const live::Now &now);

// "Deep: valid; predicted 0.32 mm from where it was imaged, +/- 0.05 mm; probe: penetration, ..."
[[nodiscard]] std::string prediction_line(const PredictionView &view);
[[nodiscard]] nlohmann::json prediction_json(const PredictionView &view);

} // namespace bregma::cli
