#include "algorithms/parallel/team.hpp"

#include <algorithm>

namespace bregma::parallel {
namespace {

// About 50 us: longer than threads differ within a step, and shorter than a wake-up.
constexpr int kSpins = 2000;

// Waits until value is no longer `old`.
void wait_for_change(const std::atomic<unsigned> &value, unsigned old) noexcept {
  for (int i = 0; i < kSpins; ++i) {
    if (value.load(std::memory_order_acquire) != old) {
      return;
    }
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
  }
  value.wait(old, std::memory_order_acquire);
}

} // namespace

Team::Team(int threads) : size_(std::max(threads, 1)) {
  for (int i = 1; i < size_; ++i) {
    threads_.emplace_back([this, i] { work(i); });
  }
}

Team::~Team() {
  stopping_.store(true, std::memory_order_relaxed);
  start();
  for (std::thread &thread : threads_) {
    thread.join();
  }
}

void Team::start() noexcept {
  if (size_ > 1) {
    job_.fetch_add(1, std::memory_order_release);
    job_.notify_all();
  }
}

void Team::barrier() noexcept {
  if (size_ == 1) {
    return;
  }
  const unsigned passed = passed_.load(std::memory_order_relaxed);
  if (arrived_.fetch_add(1, std::memory_order_acq_rel) == size_ - 1) {
    arrived_.store(0, std::memory_order_relaxed);
    passed_.store(passed + 1, std::memory_order_release);
    passed_.notify_all();
    return;
  }
  wait_for_change(passed_, passed);
}

void Team::work(int thread) noexcept {
  for (unsigned job = 0;; ++job) {
    wait_for_change(job_, job);
    if (stopping_.load(std::memory_order_relaxed)) {
      return;
    }
    call_(context_, thread);
    barrier();
  }
}

} // namespace bregma::parallel
