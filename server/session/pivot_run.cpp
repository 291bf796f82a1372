#include "server/session/pivot_run.hpp"

#include <algorithm>

#include "idl/names.hpp"

namespace bregma::server {

void PivotRun::add(const PivotPose &pose) {
  if (pose.id == id_ && job_ == nullptr && poses_.size() < max_samples_) {
    poses_.push_back(pose);
  }
}

void PivotRun::finish(const calibration::PivotOptions &options, const Executor &executor) {
  using geometry::frame::Target;
  using geometry::frame::Tool;
  const auto referenced = static_cast<std::size_t>(
      std::count_if(poses_.begin(), poses_.end(), [](const PivotPose &pose) { return pose.reference_visible; }));
  const bool from_reference = 2 * referenced >= poses_.size();
  job_ = std::make_shared<Job>();
  for (const PivotPose &pose : poses_) {
    if (pose.reference_visible || !from_reference) {
      const wire::Pose &seen = from_reference ? pose.T_reference_tool : pose.T_tracker_tool;
      job_->poses.push_back({pose.acquired_time_ns, wire::from_wire<Target, Tool>(seen)});
    }
  }
  poses_.clear();
  const auto estimate = [job = job_, options] {
    job->result = calibration::calibrate_pivot(job->poses, options);
    job->ready.store(true, std::memory_order_release);
  };
  if (executor) {
    executor(estimate);
  } else {
    estimate();
  }
}

const calibration::PivotResult *PivotRun::result() const {
  return job_ != nullptr && job_->ready.load(std::memory_order_acquire) ? &job_->result : nullptr;
}

} // namespace bregma::server
