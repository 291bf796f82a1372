// A probe that is driven along a planned trajectory into a model of the case's brain, in simulated time.
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
  double depth_mm = 0.0; // of the tip beyond where the trajectory enters the brain at rest
  double rate_hz = 60.0; // of updates: that of the daemon's deformation loop
};

struct InsertionUpdate {
  double time_s = 0.0;
  double depth_mm = 0.0; // of the tip beyond the brain's surface at rest; negative before it
  tissue::BrainState state;
  // Of the trajectory's target; not numbers where the answer is invalid, or the target lies outside the mesh.
  double target_motion_mm = 0.0, target_error_bound_mm = 0.0;
  double target_von_mises_Pa = 0.0;
  double largest_von_mises_Pa = 0.0; // in the tissue
};

// The straight way of the tip: from outside the brain to the plan's depth.
class InsertionPath {
public:
  // Refuses a trajectory that does not enter the brain, and a depth that is not in it.
  [[nodiscard]] static base::Result<InsertionPath>
  along(const casefile::Case &c, const casefile::Trajectory &trajectory, double probe_radius_mm);

  [[nodiscard]] const Eigen::Vector3d &entry_mm() const { return entry_mm_; }
  [[nodiscard]] double target_depth_mm() const { return target_depth_mm_; }
  // Before the tip touches: a probe that first appears inside the brain would come an unknown way.
  [[nodiscard]] double start_depth_mm() const { return start_depth_mm_; }
  [[nodiscard]] tissue::ProbePose pose(double depth_mm) const { return {entry_mm_ + depth_mm * along_, -along_}; }

private:
  Eigen::Vector3d entry_mm_ = Eigen::Vector3d::Zero(), along_ = Eigen::Vector3d::UnitZ();
  double target_depth_mm_ = 0.0, start_depth_mm_ = 0.0;
};

// Drives the model, whose first point is the target. goes_on is called after every update with it; where it answers
// false, what has been done so far comes back.
[[nodiscard]] std::vector<InsertionUpdate> insert(tissue::BrainModel &model, const InsertionPath &path,
                                                  const InsertionPlan &plan,
                                                  const std::function<bool(const InsertionUpdate &)> &goes_on);

// Every update that was invalid counts.
[[nodiscard]] int invalid_updates(std::span<const InsertionUpdate> updates);
// The model was put back to rest, or is invalid at the end.
[[nodiscard]] bool lost(std::span<const InsertionUpdate> updates);

// Rows about every millimetre, and where phase or status change.
[[nodiscard]] std::string insertion_table(std::span<const InsertionUpdate> updates);
// All updates, with a header of names and units.
[[nodiscard]] std::string insertion_csv(std::span<const InsertionUpdate> updates);

} // namespace bregma::cli
