// Real-time settings of a process, and checks of them. Independent of DDS: `bregma doctor` uses the same checks as the
// daemon.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace bregma::runtime {

struct ThreadOptions {
  std::string name;      // shown by ps and top; at most 15 bytes, the kernel's limit
  int fifo_priority = 0; // SCHED_FIFO 1 to 99; 0 keeps the default scheduler
  int cpu = -1;          // pin to this core; -1: the kernel chooses
  // For long computations that can wait: SCHED_BATCH with a long time slice. The thread then does not preempt others
  // when it wakes, and others preempt it. Not used with a fifo_priority. Threads that it starts inherit the setting.
  bool batch = false;
  int nice = 0; // of the ordinary scheduler: below 0 is preferred to other programs
};

// Sets up the calling thread. Returns one sentence per setting that failed. The thread continues in all cases.
[[nodiscard]] std::vector<std::string> set_up_thread(const ThreadOptions &options);

inline constexpr std::size_t kLockedBytes = std::size_t{512} << 20; // upper limit of the daemon's memory

// Whether the kernel allows locking this amount of memory.
[[nodiscard]] bool may_lock(std::size_t bytes);

// Locks all present and future memory of the process and keeps freed heap. Sentences as above.
[[nodiscard]] std::vector<std::string> lock_memory();

enum class Fitness { kGood, kLimited, kBad };

struct RealtimeCheck {
  std::string name; // for example "fifo", "memory lock", "kernel"
  Fitness fitness = Fitness::kGood;
  std::string finding; // what was found
  std::string advice;  // the setting to change; empty if the check passed
};

// Checks without changing anything: SCHED_FIFO, memory lock, real-time throttling, kernel preemption, cores, frequency
// governor, clock source, clock synchronisation, socket buffers. Blocks for a few ms.
[[nodiscard]] std::vector<RealtimeCheck> check_realtime();

struct TimerQuality {
  double p50_us = 0.0; // delay of the wake-up after its absolute deadline
  double p99_us = 0.0;
  double max_us = 0.0;
  bool fifo = false; // measured with SCHED_FIFO; false if the kernel refused it
};

// Wakes `wakes` times at the period from a thread set up like a loop's. Blocks for wakes * period_ns.
[[nodiscard]] TimerQuality measure_timer(std::int64_t period_ns, int wakes);

} // namespace bregma::runtime
