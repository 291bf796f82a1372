#include "server/runtime/loop.hpp"

#include <algorithm>
#include <cstring>
#include <ctime>
#include <future>

#include "idl/host_clock.hpp"

namespace bregma::runtime {
namespace {

// Interval at which a slow loop checks whether it must stop.
constexpr std::int64_t kMaxSleep_ns = 50'000'000;

void sleep_until(std::int64_t monotonic_ns) noexcept {
  const timespec time{monotonic_ns / 1'000'000'000, monotonic_ns % 1'000'000'000};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr);
}

std::int64_t monotonic_ns() noexcept { return wire::monotonic_now_ns(); }

} // namespace

std::uint64_t DeadlineTicker::advance(std::int64_t now_ns) noexcept {
  if (now_ns < next_ns_) {
    return 0;
  }
  const std::int64_t periods = (now_ns - next_ns_) / period_ns_ + 1;
  next_ns_ += periods * period_ns_;
  return static_cast<std::uint64_t>(periods - 1);
}

wire::LoopHealth LoopStatistics::health(const char *name, double rate_hz) const noexcept {
  wire::LoopHealth out{};
  std::strncpy(out.loop, name, sizeof out.loop - 1);
  const HistogramSnapshot durations = durations_.snapshot();
  out.rate_hz = rate_hz;
  out.steps = steps();
  out.overruns = overruns();
  out.step_p50_us = durations.percentile_ns(0.50) * 1e-3;
  out.step_p99_us = durations.percentile_ns(0.99) * 1e-3;
  out.step_max_us = static_cast<double>(durations.max_ns) * 1e-3;
  return out;
}

TimedStep::TimedStep(LoopStatistics &statistics) noexcept : statistics_(statistics), began_ns_(monotonic_ns()) {}

TimedStep::~TimedStep() { statistics_.count_step(monotonic_ns() - began_ns_); }

std::vector<std::string> PeriodicLoop::start() {
  if (thread_.joinable()) {
    return {};
  }
  stopping_.store(false, std::memory_order_relaxed);
  std::promise<std::vector<std::string>> set_up;
  auto problems = set_up.get_future();
  thread_ = std::thread([this, set_up = std::move(set_up)]() mutable {
    set_up.set_value(set_up_thread(options_.thread));
    run();
  });
  return problems.get();
}

void PeriodicLoop::stop() {
  stopping_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) {
    thread_.join();
  }
}

wire::LoopHealth PeriodicLoop::health() const noexcept {
  return statistics_.health(options_.thread.name.c_str(), 1e9 / static_cast<double>(options_.period_ns));
}

void PeriodicLoop::run() noexcept {
  DeadlineTicker ticker(options_.period_ns);
  ticker.start(monotonic_ns());
  while (!stopping_.load(std::memory_order_relaxed)) {
    const std::int64_t now_ns = monotonic_ns();
    if (!ticker.due(now_ns)) {
      sleep_until(std::min(ticker.next_ns(), now_ns + kMaxSleep_ns));
      continue;
    }
    {
      const TimedStep timed(statistics_);
      step_();
    }
    const std::uint64_t missed = ticker.advance(monotonic_ns());
    statistics_.count_overruns(options_.count_overruns ? missed : 0);
  }
}

} // namespace bregma::runtime
