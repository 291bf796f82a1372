// Work of the session that may take long, and so is done by other threads: long computations, and everything that waits
// for a disk.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>

namespace bregma::server {

enum class Work : std::uint8_t {
  kCompute, // pivot calibrations
  kLoad,    // reading a case folder, which may hang for ever: a hung job must not delay the next one for long
  kScanner, // distortion fields: up to a minute
  kSave     // snapshots and session files; one after the other, in this order
};

// Runs a job on another thread, which must not end before the job. Empty: jobs run inline, which keeps virtual time
// deterministic. Jobs own what they use, and do not throw.
using Executor = std::function<void(Work, std::function<void()>)>;

inline void execute(const Executor &executor, Work work, const std::function<void()> &job) {
  if (executor) {
    executor(work, job);
  } else {
    job();
  }
}

// The result of a job, for the thread that polls it. Shared with the job, which may end after its owner.
template <class Result> class JobResult {
public:
  void set(Result result) {
    result_ = std::move(result);
    ready_.store(true, std::memory_order_release);
  }
  // nullptr until it is set.
  [[nodiscard]] Result *get() { return ready_.load(std::memory_order_acquire) ? &result_ : nullptr; }

private:
  Result result_{};
  std::atomic<bool> ready_{false};
};

} // namespace bregma::server
