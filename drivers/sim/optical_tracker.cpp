#include "drivers/sim/optical_tracker.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <span>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/points/paired_points.hpp"
#include "idl/names.hpp"

namespace bregma::sim {

namespace {

constexpr std::size_t kMaxMarkers = 32; // bits of TrackedTool::used_markers

} // namespace

DeviceClock::DeviceClock(const TrackerParameters &parameters, std::uint64_t seed)
    : drift_(parameters.clock_drift_ppm * 1e-6), jitter_ns_(parameters.clock_jitter_ms * 1e6),
      offset_ns_(std::llround(parameters.clock_offset_ms * 1e6)), random_(seed, "tracker clock") {}

std::int64_t DeviceClock::stamp(std::int64_t host_ns) {
  start_ns_ = started_ ? start_ns_ : host_ns;
  started_ = true;
  const double drifted = drift_ * static_cast<double>(host_ns - start_ns_);
  return host_ns + offset_ns_ + std::llround(drifted + random_.normal(jitter_ns_));
}

OpticalTracker::OpticalTracker(const Patient &patient, const TrackerParameters &parameters, std::uint64_t seed)
    : patient_(&patient), parameters_(parameters), T_image_tracker_(patient.T_tracker_image.inverse()),
      cos_max_angle_(std::cos(parameters.max_marker_angle_deg * geometry::kRadiansPerDegree)),
      tan_half_width_(std::tan(parameters.half_width_deg * geometry::kRadiansPerDegree)),
      tan_half_height_(std::tan(parameters.half_height_deg * geometry::kRadiansPerDegree)), noise_(seed, "markers") {}

void OpticalTracker::place_head(const T_TrackerImage &T_tracker_image) { T_image_tracker_ = T_tracker_image.inverse(); }

bool OpticalTracker::in_volume(const Vector3d &in_tracker) const {
  const double depth = in_tracker.z();
  return depth >= parameters_.near_mm && depth <= parameters_.far_mm &&
         std::abs(in_tracker.x()) <= depth * tan_half_width_ && std::abs(in_tracker.y()) <= depth * tan_half_height_;
}

OpticalTracker::Sight OpticalTracker::look(const TrueTool &tool, const T_TrackerTool &T_tracker_tool) const {
  Sight sight;
  const Vector3d normal = T_tracker_tool.rotation() * tool.model.normal.normalized();
  for (std::size_t i = 0; i < tool.model.markers_mm.size() && i < kMaxMarkers; ++i) {
    const Vector3d marker = T_tracker_tool * tool.model.markers_mm[i];
    if (!in_volume(marker)) {
      continue;
    }
    const std::uint32_t bit = std::uint32_t{1} << i;
    sight.in_volume |= bit;
    const bool turned_away = -marker.dot(normal) < cos_max_angle_ * marker.norm(); // the camera is the origin
    if (!turned_away && !patient_->head.blocks(T_image_tracker_ * marker, T_image_tracker_.translation())) {
      sight.seen |= bit;
    }
  }
  return sight;
}

wire::TrackedTool OpticalTracker::measure(const TrueTool &tool, const T_TrackerTool &T_tracker_tool, bool covered) {
  wire::TrackedTool out{};
  (void)wire::set_name(out.tool, tool.model.name); // a loaded case has names of valid length
  out.T_tracker_tool = wire::unknown_pose();
  out.marker_rms_mm = wire::kUnknown;

  const Sight sight = look(tool, T_tracker_tool);
  const std::uint32_t seen = covered ? 0 : sight.seen;
  std::array<Vector3d, kMaxMarkers> body;
  std::array<Vector3d, kMaxMarkers> measured;
  std::size_t count = 0;
  const std::size_t markers = std::min(tool.model.markers_mm.size(), kMaxMarkers);
  for (std::size_t i = 0; i < markers; ++i) {
    const double x = noise_.normal(parameters_.noise_lateral_mm);
    const double y = noise_.normal(parameters_.noise_lateral_mm);
    const double z = noise_.normal(parameters_.noise_depth_mm);
    if ((seen >> i & 1U) != 0) {
      body[count] = tool.model.markers_mm[i];
      measured[count] = T_tracker_tool * body[count] + Vector3d(x, y, z);
      ++count;
    }
  }
  const auto fit = registration::fit_rigid(std::span(body.data(), count), std::span(measured.data(), count));
  if (!fit) {
    out.status = std::popcount(sight.in_volume) < 3 ? bregma_wire_TOOL_OUT_OF_VOLUME : bregma_wire_TOOL_HIDDEN;
    return out;
  }
  double sum = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    sum += (*fit * body[i] - measured[i]).squaredNorm();
  }
  out.status = count == markers ? bregma_wire_TOOL_VISIBLE : bregma_wire_TOOL_PARTLY_VISIBLE;
  out.used_markers = seen;
  out.T_tracker_tool = wire::to_wire(*fit);
  out.marker_rms_mm = std::sqrt(sum / static_cast<double>(count));
  return out;
}

} // namespace bregma::sim
