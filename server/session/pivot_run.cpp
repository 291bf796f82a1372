#include "server/session/pivot_run.hpp"

#include <algorithm>
#include <utility>

#include "idl/names.hpp"

namespace bregma::server {

void PivotRun::add(const PivotPose &pose) {
  if (pose.id == id_ && result_ == nullptr && poses_.size() < max_samples_) {
    poses_.push_back(pose);
  }
}

void PivotRun::finish(const calibration::PivotOptions &options, const Executor &executor) {
  using geometry::frame::Target;
  using geometry::frame::Tool;
  const auto referenced = static_cast<std::size_t>(
      std::count_if(poses_.begin(), poses_.end(), [](const PivotPose &pose) { return pose.reference_visible; }));
  const bool from_reference = 2 * referenced >= poses_.size();
  std::vector<calibration::PivotPose> poses;
  for (const PivotPose &pose : poses_) {
    if (pose.reference_visible || !from_reference) {
      const wire::Pose &seen = from_reference ? pose.T_reference_tool : pose.T_tracker_tool;
      poses.push_back({pose.acquired_time_ns, wire::from_wire<Target, Tool>(seen)});
    }
  }
  poses_.clear();
  result_ = std::make_shared<JobResult<calibration::PivotResult>>();
  execute(executor, Work::kCompute, [result = result_, poses = std::move(poses), options] {
    result->set(calibration::calibrate_pivot(poses, options));
  });
}

const calibration::PivotResult *PivotRun::result() const { return result_ != nullptr ? result_->get() : nullptr; }

} // namespace bregma::server
