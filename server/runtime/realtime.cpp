#include "server/runtime/realtime.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>

#include "server/runtime/clock.hpp"

namespace bregma::runtime {
namespace {

std::string reason(int error) { return std::string(std::strerror(error)); }

// Since Linux 6.12, sched_runtime is the time slice that a thread of this class requests. A thread with a shorter slice
// gets the core as soon as it wakes, instead of after 1 to 2 ms. Older kernels ignore it.
constexpr std::uint64_t kBatchStretch_ns = 50'000'000;

// struct sched_attr of sched_setattr(2), first version: the kernel's header and glibc's cannot both be included.
struct SchedulingAttributes {
  std::uint32_t size = sizeof(SchedulingAttributes);
  std::uint32_t policy = 0;
  std::uint64_t flags = 0;
  std::int32_t nice = 0;
  std::uint32_t priority = 0;
  std::uint64_t runtime_ns = 0, deadline_ns = 0, period_ns = 0;
};
static_assert(sizeof(SchedulingAttributes) == 48);

int set_batch() {
  SchedulingAttributes attributes;
  attributes.policy = SCHED_BATCH;
  attributes.runtime_ns = kBatchStretch_ns;
  return syscall(SYS_sched_setattr, 0, &attributes, 0U) == 0 ? 0 : errno;
}

} // namespace

std::vector<std::string> set_up_thread(const ThreadOptions &options) {
  std::vector<std::string> problems;
  const pthread_t self = pthread_self();
  if (const int error = pthread_setname_np(self, options.name.c_str()); error != 0) {
    problems.push_back("thread name '" + options.name + "' not set: " + reason(error));
  }
  if (options.fifo_priority > 0) {
    sched_param parameters{};
    parameters.sched_priority = options.fifo_priority;
    if (const int error = pthread_setschedparam(self, SCHED_FIFO, &parameters); error != 0) {
      problems.push_back("thread " + options.name + " runs without real-time priority " +
                         std::to_string(options.fifo_priority) + ": " + reason(error) +
                         " (allow it by LimitRTPRIO= or CAP_SYS_NICE)");
    }
  } else if (options.batch) {
    if (const int error = set_batch(); error != 0) {
      problems.push_back("thread " + options.name + " runs without SCHED_BATCH: " + reason(error));
    }
  }
  if (options.nice != 0 && setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), options.nice) != 0) {
    problems.push_back("thread " + options.name + " runs without nice " + std::to_string(options.nice) + ": " +
                       reason(errno));
  }
  if (options.cpu >= 0) {
    cpu_set_t cores;
    CPU_ZERO(&cores);
    CPU_SET(static_cast<unsigned>(options.cpu), &cores);
    if (const int error = pthread_setaffinity_np(self, sizeof cores, &cores); error != 0) {
      problems.push_back("thread " + options.name + " not pinned to core " + std::to_string(options.cpu) + ": " +
                         reason(error));
    }
  }
  return problems;
}

bool may_lock(std::size_t bytes) {
  void *block = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (block == MAP_FAILED) {
    return false;
  }
  const bool allowed = mlock2(block, bytes, MLOCK_ONFAULT) == 0; // uses no memory: no page is touched
  munmap(block, bytes);
  return allowed;
}

std::vector<std::string> lock_memory() {
  std::vector<std::string> problems;
  // The process keeps freed heap memory, so a page that was touched once never faults again.
  mallopt(M_TRIM_THRESHOLD, -1);
  mallopt(M_MMAP_MAX, 0);
  // With a small limit mlockall may succeed now and a later allocation may fail.
  if (!may_lock(kLockedBytes)) {
    problems.push_back("memory is not locked, and may be paged out: the limit is below " +
                       std::to_string(kLockedBytes >> 20) + " MiB (allow it by LimitMEMLOCK=infinity or CAP_IPC_LOCK)");
  } else if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    problems.push_back("memory is not locked, and may be paged out: " + reason(errno));
  }
  return problems;
}

TimerQuality measure_timer(std::int64_t period_ns, int wakes) {
  TimerQuality quality;
  std::thread([&] {
    quality.fifo = set_up_thread({.name = "timer-check", .fifo_priority = 80}).empty();
    const SystemClock clock;
    std::vector<std::int64_t> late;
    late.reserve(static_cast<std::size_t>(std::max(wakes, 1)));
    std::int64_t next = clock.monotonic_ns() + period_ns;
    for (int i = 0; i < std::max(wakes, 1); ++i) {
      const timespec deadline{next / 1'000'000'000, next % 1'000'000'000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, nullptr);
      const std::int64_t now = clock.monotonic_ns();
      late.push_back(now - next);
      next = std::max(next + period_ns, now + 1);
    }
    std::sort(late.begin(), late.end());
    const auto at = [&](double fraction) {
      return 1e-3 *
             static_cast<double>(late[static_cast<std::size_t>(fraction * static_cast<double>(late.size() - 1))]);
    };
    quality.p50_us = at(0.50);
    quality.p99_us = at(0.99);
    quality.max_us = at(1.0);
  }).join();
  return quality;
}

} // namespace bregma::runtime
