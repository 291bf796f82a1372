// A team of threads that runs short jobs together, again and again. A step of the tissue solver, or a
// comparison of two images, takes a fraction of a millisecond, so the threads meet in a barrier that spins before it
// sleeps.
//
// One thread at a time may call run() or run_parts(). They do not allocate or throw; nor may the job. With one thread
// no other is started, and they are plain calls.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <thread>
#include <type_traits>
#include <vector>

namespace bregma::parallel {

class Team {
public:
  // threads: number including the caller's; at least one.
  explicit Team(int threads);
  ~Team();
  Team(const Team &) = delete;
  Team &operator=(const Team &) = delete;

  [[nodiscard]] int size() const noexcept { return size_; }

  // Calls job(thread) on every thread, 0 being the caller's, and returns when all are done.
  template <class Job> void run(Job &&job) noexcept {
    call_ = [](void *context, int thread) { (*static_cast<std::remove_reference_t<Job> *>(context))(thread); };
    context_ = &job;
    start(kByThread);
    job(0);
    barrier();
  }

  // Calls job(part) once for each part from 0 to parts - 1, in any order, and returns when all are done. It waits for
  // no thread that has not begun: on a machine with other work a thread can wake up later than the job would take
  // alone. The job must not call barrier(). parts: below 2^31.
  template <class Job> void run_parts(std::size_t parts, Job &&job) noexcept {
    if (size_ == 1 || parts < 2) {
      for (std::size_t part = 0; part < parts; ++part) {
        job(part);
      }
      return;
    }
    call_ = [](void *context, int part) {
      (*static_cast<std::remove_reference_t<Job> *>(context))(static_cast<std::size_t>(part));
    };
    context_ = &job;
    share(static_cast<std::uint32_t>(parts));
  }

  // To be called within a job: returns when all threads have called it.
  void barrier() noexcept;

private:
  static constexpr unsigned kByThread = 0, kInParts = 1; // kind of a job: the lowest bit of its number
  void start(unsigned kind) noexcept;
  void share(std::uint32_t parts) noexcept;
  bool take_part(unsigned job) noexcept; // false: nothing is left of this job
  void work(int thread) noexcept;

  int size_;
  void (*call_)(void *, int) = nullptr;
  void *context_ = nullptr;
  std::atomic<unsigned> job_{0};    // number of the job
  std::atomic<int> arrived_{0};     // threads at the barrier
  std::atomic<unsigned> passed_{0}; // number of barriers so far
  // Of a job in parts: its number, and how many parts nobody has taken. A thread that comes late finds none, or another
  // job's number, and touches nothing of it.
  std::atomic<std::uint64_t> left_{0};
  std::atomic<unsigned> done_{0}; // parts
  std::atomic<bool> stopping_{false};
  std::vector<std::thread> threads_;
};

} // namespace bregma::parallel
