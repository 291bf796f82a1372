// One pivot calibration: collects poses, then estimates. The estimate may run on a worker while the control thread
// continues. Threads: one owner. The worker accesses only the data that finish() passes to it.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "algorithms/calibration/pivot.hpp"
#include "server/session/messages.hpp"
#include "server/session/work.hpp"

namespace bregma::server {

class PivotRun {
public:
  PivotRun(std::uint64_t id, std::string tool, std::size_t max_samples)
      : id_(id), tool_(std::move(tool)), max_samples_(max_samples) {}

  // Poses of another run, and those beyond max_samples, are ignored.
  void add(const PivotPose &pose);
  // Uses poses relative to the reference if it was visible in at least half of them, so that camera motion has no
  // effect. Otherwise uses poses relative to the tracker. Without an executor the estimate is ready on return.
  void finish(const calibration::PivotOptions &options, const Executor &executor);
  [[nodiscard]] bool finishing() const { return result_ != nullptr; }
  // Null until it is ready.
  [[nodiscard]] const calibration::PivotResult *result() const;

  [[nodiscard]] std::uint64_t id() const { return id_; }
  [[nodiscard]] const std::string &tool() const { return tool_; }

private:
  std::uint64_t id_;
  std::string tool_;
  std::size_t max_samples_;
  std::vector<PivotPose> poses_;
  std::shared_ptr<JobResult<calibration::PivotResult>> result_; // shared with the worker, which may end after the run
};

} // namespace bregma::server
