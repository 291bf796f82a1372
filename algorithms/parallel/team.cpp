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
  start(kByThread);
  for (std::thread &thread : threads_) {
    thread.join();
  }
}

void Team::start(unsigned kind) noexcept {
  if (size_ > 1) {
    const unsigned before = job_.load(std::memory_order_relaxed) & ~1U;
    job_.store((before + 2) | kind, std::memory_order_release);
    job_.notify_all();
  }
}

void Team::share(std::uint32_t parts) noexcept {
  done_.store(0, std::memory_order_relaxed);
  const unsigned job = ((job_.load(std::memory_order_relaxed) & ~1U) + 2) | kInParts;
  left_.store(std::uint64_t{job} << 32U | parts, std::memory_order_release);
  start(kInParts);
  while (take_part(job)) {
  }
  for (unsigned done = done_.load(std::memory_order_acquire); done != parts;
       done = done_.load(std::memory_order_acquire)) {
    wait_for_change(done_, done);
  }
}

// Whoever has taken a part keeps the caller in share(), so that the job's function is there until the part is done.
bool Team::take_part(unsigned job) noexcept {
  constexpr std::uint64_t kParts = 0xffffffffU;
  std::uint64_t left = left_.load(std::memory_order_acquire);
  do {
    if (left >> 32U != job || (left & kParts) == 0) {
      return false;
    }
  } while (!left_.compare_exchange_weak(left, left - 1, std::memory_order_acq_rel, std::memory_order_acquire));
  call_(context_, static_cast<int>((left & kParts) - 1));
  done_.fetch_add(1, std::memory_order_release);
  done_.notify_one();
  return true;
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
  // Jobs in parts may end without this thread, so that it continues with the latest one. It misses no other: those wait
  // for it.
  for (unsigned job = 0;;) {
    wait_for_change(job_, job);
    job = job_.load(std::memory_order_acquire);
    if (stopping_.load(std::memory_order_relaxed)) {
      return;
    }
    if ((job & kInParts) != 0) {
      while (take_part(job)) {
      }
    } else {
      call_(context_, thread);
      barrier();
    }
  }
}

} // namespace bregma::parallel
