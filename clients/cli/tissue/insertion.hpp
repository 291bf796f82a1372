// Insertion of a probe along a planned trajectory into a model of the case's brain, in simulated time.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"
#include "casefile/case.hpp"

namespace bregma::cli {

struct InsertionPlan {
  double speed_mm_s = 5.0;
  double depth_mm = 0.0; // depth of the tip beyond the trajectory's entry into the brain at rest
  double rate_hz = 60.0; // rate of updates, that of the daemon's deformation loop
};

struct InsertionUpdate {
  double time_s = 0.0;
  double depth_mm = 0.0; // depth of the tip beyond the brain's surface at rest; negative before it
  tissue::BrainState state;
  // State of the trajectory's target; NaN if the answer is invalid, or the target is outside the mesh.
  double target_motion_mm = 0.0, target_error_bound_mm = 0.0;
  double target_von_mises_Pa = 0.0;
  double largest_von_mises_Pa = 0.0; // maximum in the tissue
};

// The straight path of the tip, from outside the brain to the plan's depth.
class InsertionPath {
public:
  // Refuses a trajectory that does not enter the brain, and a depth outside the brain.
  [[nodiscard]] static base::Result<InsertionPath>
  along(const casefile::Case &c, const casefile::Trajectory &trajectory, double probe_radius_mm);

  [[nodiscard]] const Eigen::Vector3d &entry_mm() const { return entry_mm_; }
  [[nodiscard]] double target_depth_mm() const { return target_depth_mm_; }
  // Depth before the tip touches: a probe that first appears inside the brain has an unknown path.
  [[nodiscard]] double start_depth_mm() const { return start_depth_mm_; }
  [[nodiscard]] tissue::ProbePose pose(double depth_mm) const { return {entry_mm_ + depth_mm * along_, -along_}; }

private:
  Eigen::Vector3d entry_mm_ = Eigen::Vector3d::Zero(), along_ = Eigen::Vector3d::UnitZ();
  double target_depth_mm_ = 0.0, start_depth_mm_ = 0.0;
};

// Runs the model, whose first point is the target. goes_on is called with every update; if it returns false, the
// updates so far are returned.
[[nodiscard]] std::vector<InsertionUpdate> insert(tissue::BrainModel &model, const InsertionPath &path,
                                                  const InsertionPlan &plan,
                                                  const std::function<bool(const InsertionUpdate &)> &goes_on);

// Number of invalid updates.
[[nodiscard]] int invalid_updates(std::span<const InsertionUpdate> updates);
// The model was reset to rest, or is invalid at the end.
[[nodiscard]] bool lost(std::span<const InsertionUpdate> updates);

// One row per millimetre, and where phase or status change.
[[nodiscard]] std::string insertion_table(std::span<const InsertionUpdate> updates);
// All updates, with a header of names and units.
[[nodiscard]] std::string insertion_csv(std::span<const InsertionUpdate> updates);

} // namespace bregma::cli
