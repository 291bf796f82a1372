// What a process can ask of the kernel for real time, and whether it gets it. Knows no DDS: `bregma doctor` uses the
// same checks as the daemon.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace bregma::runtime {

struct ThreadOptions {
  std::string name;      // shown by ps and top; at most 15 bytes, the kernel's limit
  int fifo_priority = 0; // SCHED_FIFO 1 to 99; 0 keeps the ordinary scheduler
  int cpu = -1;          // pin to this core; -1 leaves it to the kernel
  // Computes for long and can wait: SCHED_BATCH with a long stretch, so that it does not take a core from others when
  // it wakes up, and leaves its own to them when they do. Not used with a fifo_priority. Threads that it starts inherit
  // this.
  bool batch = false;
};

// Sets up the calling thread. Returns one sentence for each thing that could not be set; the thread runs on regardless.
[[nodiscard]] std::vector<std::string> set_up_thread(const ThreadOptions &options);

inline constexpr std::size_t kLockedBytes = std::size_t{512} << 20; // what the daemon may come to need

// Whether the kernel would let so much memory be locked.
[[nodiscard]] bool may_lock(std::size_t bytes);

// Locks all present and future memory of the process and keeps freed heap. Sentences as above.
[[nodiscard]] std::vector<std::string> lock_memory();

enum class Fitness { kGood, kLimited, kBad };

struct RealtimeCheck {
  std::string name; // for example "fifo", "memory lock", "kernel"
  Fitness fitness = Fitness::kGood;
  std::string finding; // what was found
  std::string advice;  // what to set; empty when good
};

// Looks, and sets nothing: SCHED_FIFO, memory lock, real-time throttling, kernel preemption, cores, frequency governor,
// clock source, clock synchronisation, socket buffers. Blocks for a few ms.
[[nodiscard]] std::vector<RealtimeCheck> check_realtime();

struct TimerQuality {
  double p50_us = 0.0; // how late the thread woke after its absolute deadline
  double p99_us = 0.0;
  double max_us = 0.0;
  bool fifo = false; // measured with SCHED_FIFO (else the kernel refused it)
};

// Wakes `wakes` times at the period from a thread set up like a loop's. Blocks for wakes * period_ns.
[[nodiscard]] TimerQuality measure_timer(std::int64_t period_ns, int wakes);

} // namespace bregma::runtime
