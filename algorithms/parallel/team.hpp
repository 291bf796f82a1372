// A team of threads that runs short jobs together, again and again. A step of the tissue solver, or a
// comparison of two images, takes a fraction of a millisecond, so the threads meet in a barrier that spins before it
// sleeps.
//
// One thread at a time may call run(). run() does not allocate or throw; nor may the job. With one thread no other is
// started, and run() is a plain call.
#pragma once

#include <atomic>
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
    start();
    job(0);
    barrier();
  }

  // To be called within a job: returns when all threads have called it.
  void barrier() noexcept;

private:
  void start() noexcept;
  void work(int thread) noexcept;

  int size_;
  void (*call_)(void *, int) = nullptr;
  void *context_ = nullptr;
  std::atomic<unsigned> job_{0};    // incremented per job
  std::atomic<int> arrived_{0};     // threads at the barrier
  std::atomic<unsigned> passed_{0}; // number of barriers so far
  std::atomic<bool> stopping_{false};
  std::vector<std::thread> threads_;
};

} // namespace bregma::parallel
