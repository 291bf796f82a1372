// Clearance of a planned path from the critical structures of a case, with the error that the case's images add to it.
#pragma once

#include <string>
#include <vector>

#include "algorithms/planning/critical_structures.hpp"
#include "casefile/case.hpp"

namespace bregma::case_model {

struct PathClearance {
  std::string structure;
  double distance_mm = 0.0; // 0: the path passes through it
  // 1-sigma error of the distance: that of the registrations of the images in which the path was placed and the
  // structure was segmented, along the line between their nearest points. 0 where both are of one image: its error
  // moves both alike. It does not contain the errors of a segmentation or of the patient's registration.
  double image_sigma_mm = 0.0;
};

// Every structure, nearest first. Image, mm. `structures` holds c.structures in their order. Allocates.
[[nodiscard]] std::vector<PathClearance> path_clearances(const casefile::Case &c,
                                                         const planning::CriticalStructures &structures,
                                                         const casefile::Trajectory &path);

} // namespace bregma::case_model
