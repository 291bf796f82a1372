// A tracked body as a tracker reports it: every marker with its noise, and the pose fitted to them.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "algorithms/registration/points/paired_points.hpp"
#include "casefile/case.hpp"
#include "idl/names.hpp"
#include "idl/topics.hpp"

namespace bregma::test {

struct MarkerNoise { // 1 sigma of a coordinate, along the tracker's axes
  double lateral_mm = 0.10;
  double depth_mm = 0.25;
};

[[nodiscard]] inline wire::TrackedTool
measured_markers(const casefile::ToolModel &model,
                 const geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool> &T_tracker_tool,
                 const MarkerNoise &noise, std::mt19937 &rng) {
  std::normal_distribution<double> normal;
  std::vector<geometry::Vector3d> markers;
  for (const geometry::Vector3d &marker : model.markers_mm) {
    const geometry::Vector3d error(noise.lateral_mm * normal(rng), noise.lateral_mm * normal(rng),
                                   noise.depth_mm * normal(rng));
    markers.push_back(T_tracker_tool * marker + error);
  }
  const auto fit = registration::fit_rigid(model.markers_mm, markers);
  double sum = 0.0;
  for (std::size_t i = 0; i < markers.size(); ++i) {
    sum += (*fit * model.markers_mm[i] - markers[i]).squaredNorm();
  }
  wire::TrackedTool out{};
  (void)wire::set_name(out.tool, model.name);
  out.status = bregma_wire_TOOL_VISIBLE;
  out.used_markers = (1U << markers.size()) - 1U;
  out.T_tracker_tool = wire::to_wire(*fit);
  out.marker_rms_mm = std::sqrt(sum / static_cast<double>(markers.size()));
  return out;
}

} // namespace bregma::test
