// One pivot calibration: poses as they come, then the estimate, which may run on a worker while the control thread goes
// on. Threads: one owner; the worker sees only what finish() hands it.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "algorithms/calibration/pivot.hpp"
#include "server/session/messages.hpp"

namespace bregma::server {

class PivotRun {
public:
  using Executor = std::function<void(std::function<void()>)>;

  PivotRun(std::uint64_t id, std::string tool, std::size_t max_samples)
      : id_(id), tool_(std::move(tool)), max_samples_(max_samples) {}

  // Poses of another run, and those beyond max_samples, are ignored.
  void add(const PivotPose &pose);
  // Takes the poses seen from the reference where it was visible in at least half of them (a moved camera does no harm
  // then), else those seen from the tracker. Without an executor the estimate is ready on return.
  void finish(const calibration::PivotOptions &options, const Executor &executor);
  [[nodiscard]] bool finishing() const { return job_ != nullptr; }
  // Null until it is ready.
  [[nodiscard]] const calibration::PivotResult *result() const;

  [[nodiscard]] std::uint64_t id() const { return id_; }
  [[nodiscard]] const std::string &tool() const { return tool_; }

private:
  struct Job {
    std::vector<calibration::PivotPose> poses;
    calibration::PivotResult result;
    std::atomic<bool> ready = false;
  };

  std::uint64_t id_;
  std::string tool_;
  std::size_t max_samples_;
  std::vector<PivotPose> poses_;
  std::shared_ptr<Job> job_; // shared with the worker, which may outlive the run
};

} // namespace bregma::server
