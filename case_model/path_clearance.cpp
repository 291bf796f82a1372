#include "case_model/path_clearance.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::case_model {

namespace {

double image_sigma_mm(const casefile::Case &c, const casefile::Trajectory &path, const casefile::Surface &structure,
                      const planning::ClosestApproach &approach) {
  double variance = 0.0;
  for (const casefile::RegisteredImage &image : c.images) {
    // The error of this image's registration moves the path's nearest point and the structure's by J times it.
    geometry::Matrix36d J = geometry::Matrix36d::Zero();
    if (path.entry_in == image.name) {
      J += (1.0 - approach.fraction) * geometry::point_jacobian(path.entry_mm);
    }
    if (path.target_in == image.name) {
      J += approach.fraction * geometry::point_jacobian(path.target_mm);
    }
    if (structure.segmented_in == image.name) {
      J -= geometry::point_jacobian(approach.surface.point_mm);
    }
    const geometry::Vector6d by_pose = J.transpose() * approach.surface.direction;
    variance += by_pose.dot(image.T_image_source.covariance * by_pose);
  }
  return std::sqrt(std::max(variance, 0.0));
}

} // namespace

std::vector<PathClearance> path_clearances(const casefile::Case &c, const planning::CriticalStructures &structures,
                                           const casefile::Trajectory &path) {
  std::vector<PathClearance> out;
  for (const auto &clearance : structures.path_clearance(path.entry_mm, path.target_mm)) {
    const auto approach = structures.closest_approach(clearance.index, path.entry_mm, path.target_mm);
    out.push_back({clearance.name, clearance.distance_mm,
                   image_sigma_mm(c, path, c.structures.at(static_cast<std::size_t>(clearance.index)), approach)});
  }
  return out;
}

} // namespace bregma::case_model
